"""What the world shows of itself: failures, events, the truth."""

from dataclasses import dataclass
from enum import StrEnum

from solver.zones import Point, Zone, ZoneKind


@dataclass(frozen=True, slots=True)
class Failures:
    """What a robot cannot do at the moment."""

    sensing: bool = False
    """No measurements."""

    communication: bool = False
    """No messages either way."""

    def of(self, kind: ZoneKind) -> bool:
        """Return whether the failure that zones of this kind cause is there."""
        return self.sensing if kind is ZoneKind.SENSING else self.communication


class Cause(StrEnum):
    """Why a zone hit."""

    DICE = "dice"
    SPREAD = "spread"
    """Jammed for certain: too near for a team spread so far."""


@dataclass(frozen=True, slots=True)
class Hit:
    """A zone hit a robot in this step. Counts even while the robot is failing already."""

    robot_id: int
    kind: ZoneKind
    zone: Zone | None
    """As revealed: exact at this moment, None where nothing is revealed."""

    cause: Cause
    time_s: float


@dataclass(frozen=True, slots=True)
class Recovery:
    """A failure ended in this step."""

    robot_id: int
    kind: ZoneKind
    time_s: float


WorldEvent = Hit | Recovery


@dataclass(frozen=True, slots=True)
class TrueRobot:
    """One robot as it really is."""

    id: int
    position: Point
    velocity: Point
    altitude_m: float
    failures: Failures


@dataclass(frozen=True, slots=True)
class TrueTarget:
    """One target as it really is."""

    id: int
    position: Point
    velocity: Point


@dataclass(frozen=True, slots=True)
class Truth:
    """Everything, as it really is at one moment."""

    time_s: float
    step: int
    robots: tuple[TrueRobot, ...]
    targets: tuple[TrueTarget, ...]
    zones: tuple[Zone, ...]
