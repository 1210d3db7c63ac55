"""What missions can be made from: scenarios by name, and configured model profiles."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from server.api.models import Clock, LlmProfile, MissionRequest, ScenarioInfo
from server.mission.setup import GateMode


@dataclass(frozen=True, slots=True)
class Definition:
    """A checked mission, ready to be handed to processes of its own."""

    scenario: str
    llm: str
    seed: int
    clock: Clock
    gate: GateMode
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

    def describe(self, scenario: dict[str, Any]) -> ScenarioInfo:
        """Check a whole scenario and return what it is. Raises ServiceError 422."""
        ...

    def bus(self, planner: Mapping[str, Any]) -> dict[str, Any]:
        """Return where a stored planner job stands on the bus by the settings, as JSON values.

        Raises KeyError and ValueError for a job of another version.
        """
        ...

    def define(self, request: MissionRequest) -> Definition:
        """Check a request and return what to run. Raises ServiceError naming what is wrong."""
        ...

    def model_address(self, profile: str) -> str:
        """Return what a profile stands for. Raises ServiceError where there is none such."""
        ...
