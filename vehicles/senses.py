"""What an agent notices of the world: the seam between the agent and its sensors."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from solver.observations import Detections
from solver.zones import Zone, ZoneKind
from vehicles.world.state import Failures


@dataclass(frozen=True, slots=True)
class Struck:
    """A zone hit this robot."""

    kind: ZoneKind
    zone: Zone | None
    """As revealed, None where nothing was."""


@dataclass(frozen=True, slots=True)
class Recovered:
    """A failure of this robot has ended."""

    kind: ZoneKind


Incident = Struck | Recovered


class Senses(Protocol):
    """A robot's sensors and what it knows of its own failures. No call blocks."""

    def failures(self) -> Failures:
        """Return what the robot cannot do now. Jammed is more than hearing nothing: it knows."""
        ...

    def detect(self, target_ids: Iterable[int]) -> Detections | None:
        """Return what it sees of these targets now, None when it cannot see."""
        ...

    def take_incidents(self) -> tuple[Incident, ...]:
        """Return what has befallen it since the last call, oldest first."""
        ...


class Sight(StrEnum):
    """Who sees targets for a vehicle that is not simulated."""

    NONE = "none"
    """Nobody: it flies, and others see."""

    WORLD = "world"
    """The simulated world, which also blinds and jams it (`vehicles.world_link`)."""


class NoSenses:
    """A robot without sensors for targets and failures."""

    def failures(self) -> Failures:
        """Return that nothing fails."""
        return Failures()

    def detect(self, target_ids: Iterable[int]) -> Detections | None:
        """Return that it sees nothing."""
        return None

    def take_incidents(self) -> tuple[Incident, ...]:
        """Return that nothing befell it."""
        return ()
