"""What reaches the mission core from outside: facts about robots, targets, zones, people.

Plain values only (ids, floats, tuples), so that every input can be recorded as JSON and
replayed bit for bit. Lengths in metres, time in seconds of mission time, angles in
radians, frame ENU.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from solver.zones import Matrix2, Point, Zone, ZoneKind


class Link(StrEnum):
    """How the team reaches a robot."""

    CONNECTED = "connected"
    JAMMED = "jammed"
    """Communication failure: silent, but alive. It flies on board; its row is frozen."""

    LOST = "lost"
    """Gone. It gives no cover and its capacity is 0."""


@dataclass(frozen=True, slots=True)
class RobotState:
    """A robot's own report of where it is. Newest wins."""

    robot_id: int
    position: Point
    velocity: Point
    altitude_m: float
    sensing_failed: bool
    type: Literal["robot_state"] = "robot_state"


@dataclass(frozen=True, slots=True)
class Sighting:
    """Range and bearing (ENU, atan2 of north over east) from a robot to a target."""

    target_id: int
    range_m: float
    bearing_rad: float


@dataclass(frozen=True, slots=True)
class Detections:
    """What one robot saw at one moment, with the position it saw it from."""

    robot_id: int
    position: Point
    sightings: tuple[Sighting, ...]
    type: Literal["detections"] = "detections"


@dataclass(frozen=True, slots=True)
class Attack:
    """A zone hit a robot. Reported by the robot, at once or after it reconnects."""

    robot_id: int
    kind: ZoneKind
    zone: Zone | None
    """The zone as revealed by the attack (oracle discovery), None when unknown."""

    time_s: float
    type: Literal["attack"] = "attack"


@dataclass(frozen=True, slots=True)
class LinkChange:
    """A robot was jammed, lost or came back."""

    robot_id: int
    link: Link
    reason: str
    type: Literal["link_change"] = "link_change"


@dataclass(frozen=True, slots=True)
class OnboardTrack:
    """One target as a robot's own filter believes it: state (x, y[, vx, vy])."""

    target_id: int
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class TrackReport:
    """What a robot brings when it returns: its tracks, the zones it knows, where it was silent."""

    robot_id: int
    tracks: tuple[OnboardTrack, ...]
    zones: tuple[Zone, ...]
    silent: tuple[Point, ...] = ()
    """Places where nobody heard it, metres; told where zones are inferred."""

    type: Literal["track_report"] = "track_report"


@dataclass(frozen=True, slots=True)
class Comment:
    """One sentence of a human supervisor. Data, never an instruction to our own code."""

    id: str
    text: str
    time_s: float
    ttl_s: float
    author: str = "operator"
    type: Literal["comment"] = "comment"


@dataclass(frozen=True, slots=True)
class ZoneDrawn:
    """A zone drawn by a person: known to the whole team at once."""

    zone: Zone
    author: str = "operator"
    type: Literal["zone_drawn"] = "zone_drawn"


@dataclass(frozen=True, slots=True)
class ZoneErased:
    """A zone that is no longer there, says a person. It comes back when it hits again."""

    zone_id: str
    author: str = "operator"
    type: Literal["zone_erased"] = "zone_erased"


@dataclass(frozen=True, slots=True)
class TargetPrior:
    """Prior knowledge: a target's believed start, position and covariance."""

    target_id: int
    mean: Point
    covariance: Matrix2
    type: Literal["prior"] = "prior"


class HoldState(StrEnum):
    """Whether setpoints carry motion."""

    FLYING = "flying"
    HELD = "held"


@dataclass(frozen=True, slots=True)
class HoldChange:
    """Hold all, or resume. Never gated."""

    state: HoldState
    author: str = "operator"
    type: Literal["hold_change"] = "hold_change"


Observation = (
    RobotState
    | Detections
    | Attack
    | LinkChange
    | TrackReport
    | Comment
    | ZoneDrawn
    | ZoneErased
    | TargetPrior
    | HoldChange
)
