"""Every message of the bus as a checked, frozen model (docs/messages.md)."""

from enum import StrEnum
from math import pi
from typing import Annotated, Literal, Self, TypeAlias, TypeVar

from pydantic import Field, ValidationError, model_validator

from solver.zones import ZoneKind
from vehicles.fields import (
    Amount,
    Count,
    Duration,
    Id,
    Length,
    Name,
    Number,
    Position,
    Risk,
    Velocity,
    Wire,
    Words,
)
from vehicles.problems import problems_of
from vehicles.rule_parts import RulesPart

VERSION = 1
MAX_PAYLOAD = 1 << 20
"""Bytes; more is refused unread."""


class MessageError(ValueError):
    """Raised when a payload is not the message it should be."""


class Message(Wire):
    """What every message carries."""

    v: Literal[1]
    boot: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
    seq: Count
    stamp_s: Duration


class Mode(StrEnum):
    """What a robot flies by."""

    HOLDING = "holding"
    FLYING = "flying"
    ONBOARD = "onboard"
    RETURNING = "returning"
    LANDING = "landing"
    LANDED = "landed"
    CLIMBING = "climbing"
    MANUAL = "manual"


class Order(StrEnum):
    """What an operator can tell one robot."""

    HOLD = "hold"
    LAND = "land"
    RETURN = "return"
    TAKE_OFF = "take_off"
    RESUME = "resume"


class PlannerState(StrEnum):
    """What the planner is doing."""

    RUNNING = "running"
    HELD = "held"
    PAUSED = "paused"


class WorldState(StrEnum):
    """Whether the simulated world's time goes on."""

    RUNNING = "running"
    PAUSED = "paused"


class WorldAction(StrEnum):
    """Orders to the simulated world."""

    PAUSE = "pause"
    RESUME = "resume"
    RESET = "reset"


# ---------------------------------------------------------------------- parts


class ZonePart(Wire):
    """A danger zone."""

    id: Name
    kind: ZoneKind
    mean: Position
    covariance: tuple[tuple[Number, Number], tuple[Number, Number]]
    margin: Amount
    risk: Risk
    risk_single: Risk

    @model_validator(mode="after")
    def _positive_definite(self) -> Self:
        (a, b), (c, d) = self.covariance
        if abs(b - c) > 1e-6 * max(abs(a), abs(d)) or a <= 0.0 or a * d - b * c <= 0.0:
            raise ValueError("covariance is not symmetric positive definite")
        return self


class TrackPart(Wire):
    """A belief of one target."""

    target_id: Id
    mean: Annotated[tuple[Number, ...], Field(min_length=2, max_length=4)]
    covariance: Annotated[
        tuple[Annotated[tuple[Number, ...], Field(max_length=4)], ...], Field(max_length=4)
    ]

    @model_validator(mode="after")
    def _square(self) -> Self:
        size = len(self.mean)
        if size == 3 or [len(row) for row in self.covariance] != [size] * size:
            raise ValueError("a track has 2 or 4 numbers and as square a covariance")
        return self


class SightingPart(Wire):
    """Range and bearing to one target."""

    target_id: Id
    range_m: Length
    bearing_rad: Annotated[float, Field(ge=-pi, le=pi)]


class MatePart(Wire):
    """Where another robot was last known to be."""

    robot_id: Id
    position: Position


class AttackPart(Wire):
    """A zone hit the robot."""

    type: Literal["attack"] = "attack"
    kind: ZoneKind
    zone: ZonePart | None


class RecoveryPart(Wire):
    """A failure has ended."""

    type: Literal["recovery"] = "recovery"
    kind: ZoneKind


class ModePart(Wire):
    """The robot flies by something else from now on."""

    type: Literal["mode"] = "mode"
    mode: Mode
    previous: Mode
    reason: Words
    command_id: Name | None = None


class ReturnPart(Wire):
    """The robot is back from a communication failure."""

    type: Literal["return"] = "return"
    tracks: Annotated[tuple[TrackPart, ...], Field(max_length=1024)]
    zones: Annotated[tuple[ZonePart, ...], Field(max_length=256)]
    silent: Annotated[tuple[Position, ...], Field(max_length=256)] = ()


class NoticePart(Wire):
    """Something else that people should know."""

    type: Literal["notice"] = "notice"
    code: Name
    text: Words
    command_id: Name | None = None


class TrueRobotPart(Wire):
    """One robot as it really is."""

    id: Id
    position: Position
    velocity: Velocity
    altitude_m: Length
    sensing_failed: bool
    jammed: bool


class TrueTargetPart(Wire):
    """One target as it really is."""

    id: Id
    position: Position
    velocity: Velocity


class HitsPart(Wire):
    """How often zones have hit."""

    sensing: Count
    communication: Count


EventPart: TypeAlias = Annotated[
    AttackPart | RecoveryPart | ModePart | ReturnPart | NoticePart, Field(discriminator="type")
]

# ---------------------------------------------------------------------- messages


class State(Message):
    """Where a robot is."""

    robot_id: Id
    position: Position
    velocity: Velocity
    altitude_m: Length
    sensing_failed: bool
    mode: Mode


class Detections(Message):
    """What a robot saw at one moment."""

    robot_id: Id
    position: Position
    sightings: Annotated[tuple[SightingPart, ...], Field(max_length=4096)]


class Health(Message):
    """How a robot is."""

    robot_id: Id
    mode: Mode
    reason: Words
    uptime_s: Duration
    battery: Annotated[float, Field(ge=0.0, le=1.0)] | None
    heartbeat_age_s: Duration | None
    setpoints: Count
    refused: Count
    dropped: Count
    plan_s: Duration | None


class Event(Message):
    """Something happened on a robot."""

    robot_id: Id
    age_s: Duration
    event: EventPart


class Setpoint(Message):
    """Fly at this velocity until it expires."""

    robot_id: Id
    mission: Name
    ttl_s: Annotated[float, Field(gt=0.0, le=10.0)]
    velocity: Velocity
    waypoint: Position
    altitude_m: Length


class Knowledge(Message):
    """What a robot takes along when it is cut off."""

    robot_id: Id
    mission: Name
    rules: RulesPart
    weights: tuple[Amount, Amount, Amount, Amount]
    targets: Annotated[tuple[Id, ...], Field(max_length=1024)]
    tracks: Annotated[tuple[TrackPart, ...], Field(max_length=1024)]
    zones: Annotated[tuple[ZonePart, ...], Field(max_length=256)]
    severities: Annotated[
        tuple[tuple[Name, Annotated[float, Field(ge=0.1, le=10.0)]], ...], Field(max_length=256)
    ]
    mates: Annotated[tuple[MatePart, ...], Field(max_length=2048)]
    prices: tuple[Amount, Amount]


class Command(Message):
    """An operator's order to one robot."""

    robot_id: Id
    command: Order
    command_id: Name
    author: Annotated[str, Field(max_length=100)]


class Heartbeat(Message):
    """The planner's tick is alive."""

    mission: Name
    tick: Annotated[int, Field(ge=-1, lt=2**53)]
    time_s: Number
    state: PlannerState


class Truth(Message):
    """The simulated world as it really is."""

    time_s: Duration
    step: Count
    state: WorldState
    robots: Annotated[tuple[TrueRobotPart, ...], Field(max_length=2048)]
    targets: Annotated[tuple[TrueTargetPart, ...], Field(max_length=4096)]
    zones: Annotated[tuple[ZonePart, ...], Field(max_length=256)]
    hits: HitsPart


class WorldControl(Message):
    """An order to the simulated world."""

    action: WorldAction
    seed: Count | None


MessageT = TypeVar("MessageT", bound=Message)


def encode(message: Message) -> bytes:
    """Return a message as it goes on the wire."""
    return message.model_dump_json().encode()


def decode(kind: type[MessageT], payload: bytes) -> MessageT:
    """Return the message in a payload.

    Raises:
        MessageError: When it is too long, not JSON, of another version, or breaks a bound. The
            text names the fields, never their contents.
    """
    if len(payload) > MAX_PAYLOAD:
        raise MessageError(f"{kind.__name__}: {len(payload)} bytes are more than {MAX_PAYLOAD}")
    try:
        return kind.model_validate_json(payload)
    except ValidationError as error:
        words = problems_of(error, "payload", most=5)
        raise MessageError(f"{kind.__name__}: {words}") from None
