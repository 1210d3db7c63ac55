"""What missions can be made from: scenarios by name, and configured model profiles."""

from dataclasses import dataclass
from typing import Any, Protocol

from server.api.models import Clock, LlmProfile, MissionRequest, ScenarioInfo


@dataclass(frozen=True, slots=True)
class Definition:
    """A checked mission, ready to be handed to processes of its own."""

    scenario: str
    llm: str
    seed: int
    clock: Clock
    planner: dict[str, Any]
    """The planner's job (server.live.job), as JSON values."""

    world: dict[str, Any] | None
    """The simulated world's job (vehicles.sim_worker), None when the vehicles are elsewhere."""


class Catalogue(Protocol):
    """Knows scenarios and model profiles."""

    def scenarios(self) -> tuple[ScenarioInfo, ...]:
        """Return every scenario known by name."""
        ...

    def profiles(self) -> tuple[LlmProfile, ...]:
        """Return every configured model profile."""
        ...

    def define(self, request: MissionRequest) -> Definition:
        """Check a request and return what to run. Raises ServiceError naming what is wrong."""
        ...
