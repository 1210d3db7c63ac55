"""The simulated autopilot's own mind: modes, arming, failsafes. No wire, no I/O."""

import math
from dataclasses import dataclass, field
from enum import StrEnum

from vehicles.mavlink.airframe import Airframe, AirframeSettings
from vehicles.mavlink.dialects import ARDUPILOT, Autopilot, Dialect, TakeOff
from vehicles.mavlink.frames import Vector

WARNING, INFORMATION = 4, 6
"""MAV_SEVERITY of what it says."""

DESCENT_M_S = 0.7
NEAR_M = 0.3
LANDED_M = 0.05
CLIMB_M_S = 1.5


class Answer(StrEnum):
    """What becomes of a request."""

    ACCEPTED = "accepted"
    BUSY = "busy"
    """Not now."""

    DENIED = "denied"


class Start(StrEnum):
    """How it begins."""

    GROUND = "ground"
    AIRBORNE = "airborne"
    """In the air and following setpoints."""


@dataclass(frozen=True, slots=True)
class FlightSettings:
    """How the autopilot is set up; lengths in its local ENU frame."""

    dialect: Dialect = ARDUPILOT
    airframe: AirframeSettings = field(default_factory=AirframeSettings)
    home: Vector = (0.0, 0.0, 0.0)
    start: Start = Start.GROUND
    start_altitude_m: float = 2.0
    """When it starts in the air."""

    setpoint_loss_s: float | None = None
    """After so long without a setpoint it stops; None for what is usual: 3 s for ArduPilot
    (which holds and goes on listening), 1 s for PX4 (which changes to HOLD)."""

    beat_loss_s: float | None = None
    """After so long without a heartbeat, once there was one, it returns; None for never."""

    battery_start: float = 1.0
    battery_s: float = 1200.0
    """Flight time of a full battery."""

    battery_failsafe: float = 0.15
    fence_radius_m: float = 1000.0
    return_altitude_m: float = 5.0
    refused_modes: frozenset[int] = frozenset()


@dataclass(slots=True)
class Spoken:
    """A line for people."""

    severity: int
    text: str


@dataclass(slots=True)
class Reference:
    """The last setpoint taken; `place` None for velocity alone."""

    place: Vector | None
    velocity: Vector
    at_s: float


@dataclass(slots=True)
class Flight:
    """The autopilot in flight; `step` lets time pass."""

    settings: FlightSettings
    mode: int = 0
    armed: bool = False
    battery: float = 1.0
    fence_breached: bool = False
    spoken: list[Spoken] = field(default_factory=list)
    body: Airframe = field(init=False)
    _reference: Reference | None = None
    _streamed_s: float = -math.inf
    _beat_s: float | None = None
    _anchor: Vector = (0.0, 0.0, 0.0)
    _climb_to_m: float | None = None
    _battery_called: bool = False
    _stepped_s: float | None = None

    def __post_init__(self) -> None:
        """Stand at home, or hang above it."""
        settings = self.settings
        x, y, z = settings.home
        self.battery = settings.battery_start
        self.mode = settings.dialect.hold
        if settings.start is Start.AIRBORNE:
            z += settings.start_altitude_m
            self.armed, self.mode = True, settings.dialect.follow
        self.body = Airframe(settings.airframe, (x, y, z))
        self._anchor = self.body.position

    @property
    def landed(self) -> bool:
        """Whether it stands on the ground."""
        return self.body.position[2] - self.settings.home[2] < LANDED_M

    @property
    def loss_s(self) -> float:
        """How long it flies on without a setpoint."""
        if self.settings.setpoint_loss_s is not None:
            return self.settings.setpoint_loss_s
        return 1.0 if self.settings.dialect.autopilot is Autopilot.PX4 else 3.0

    # ------------------------------------------------------------------ requests

    def change_mode(self, mode: int, now_s: float) -> Answer:
        """Change the mode, by whoever asks."""
        dialect = self.settings.dialect
        if mode in self.settings.refused_modes or mode not in dialect.names:
            return Answer.DENIED
        streamed = now_s - self._streamed_s <= 0.5
        if mode == dialect.follow and dialect.stream_first_s and not streamed:
            return Answer.BUSY
        if mode != self.mode:
            self._enter(mode, now_s)
        return Answer.ACCEPTED

    def arm(self) -> Answer:
        """Start the motors."""
        self.armed = True
        return Answer.ACCEPTED

    def disarm(self) -> Answer:
        """Stop the motors, on the ground."""
        if not self.landed:
            return Answer.DENIED
        self.armed = False
        self._climb_to_m = None
        return Answer.ACCEPTED

    def take_off(self, altitude_m: float, now_s: float) -> Answer:
        """Climb to an altitude above home; ArduPilot only when armed and in GUIDED."""
        dialect = self.settings.dialect
        by_command = dialect.take_off is TakeOff.COMMAND
        if not (0.0 < altitude_m <= 1000.0):
            return Answer.DENIED
        if not self.armed or (by_command and self.mode != dialect.follow):
            return Answer.DENIED
        if not by_command:
            self._enter(dialect.hold, now_s)
        self._climb_to_m = self.settings.home[2] + altitude_m
        self._anchor = self.body.position
        return Answer.ACCEPTED

    def take_setpoint(self, place: Vector | None, velocity: Vector, now_s: float) -> None:
        """Take a setpoint; it counts in the following mode only."""
        self._streamed_s = now_s
        if self.mode == self.settings.dialect.follow:
            self._reference = Reference(place, velocity, now_s)

    def take_beat(self, now_s: float) -> None:
        """Take the heartbeat of whoever controls it."""
        self._beat_s = now_s

    # ------------------------------------------------------------------ time

    def step(self, now_s: float) -> None:
        """Let time pass up to `now_s`."""
        before_s, self._stepped_s = self._stepped_s, now_s
        if before_s is None or now_s <= before_s:
            return
        dt_s = now_s - before_s
        if not self.armed:
            return
        self.battery = max(self.battery - dt_s / self.settings.battery_s, 0.0)
        self._watch(now_s)
        self._fly(now_s, dt_s)

    def _fly(self, now_s: float, dt_s: float) -> None:
        dialect = self.settings.dialect
        if self._climb_to_m is not None:
            self._climb(self._climb_to_m, dt_s)
        elif self.mode == dialect.follow and self._reference is not None:
            reference, age_s = self._reference, now_s - self._reference.at_s
            place = reference.place
            if place is not None and dialect.autopilot is Autopilot.ARDUPILOT:
                # ArduPilot moves the position on by the velocity between two setpoints.
                x, y, z = (a + b * age_s for a, b in zip(place, reference.velocity, strict=True))
                place = (x, y, z)
            self.body.chase(place, reference.velocity, dt_s)
        elif self.mode == dialect.land:
            self._descend(dt_s)
        elif self.mode == dialect.return_home:
            self._return(dt_s)
        elif not self.landed:
            self.body.chase(self._anchor, (0.0, 0.0, 0.0), dt_s)
        if self.body.position[2] < self.settings.home[2]:
            self.body.rest(self.settings.home[2])

    def _climb(self, to_m: float, dt_s: float) -> None:
        x, y, _ = self._anchor
        z = self.body.position[2]
        rate_m_s = CLIMB_M_S if z < to_m else 0.0
        self.body.chase((x, y, min(z, to_m)), (0.0, 0.0, rate_m_s), dt_s)
        if self.body.position[2] >= to_m - LANDED_M:
            self._anchor, self._climb_to_m = (x, y, to_m), None

    def _descend(self, dt_s: float) -> None:
        x, y, _ = self._anchor
        self.body.chase((x, y, self.body.position[2]), (0.0, 0.0, -DESCENT_M_S), dt_s)
        if self.landed:
            self.body.rest(self.settings.home[2])
            self.armed = False
            self._say(INFORMATION, "Landed, motors off")

    def _return(self, dt_s: float) -> None:
        x, y, z = self.settings.home
        if math.dist(self.body.position[:2], (x, y)) <= NEAR_M:
            self._anchor = (x, y, z)
            self._descend(dt_s)
            return
        high = max(self._anchor[2], z + self.settings.return_altitude_m)
        self.body.chase((x, y, high), (0.0, 0.0, 0.0), dt_s)

    # ------------------------------------------------------------------ failsafes

    def _watch(self, now_s: float) -> None:
        dialect = self.settings.dialect
        heard_s = math.inf if self._reference is None else self._reference.at_s
        if self.mode == dialect.follow and now_s - heard_s > self.loss_s:
            self._lose_setpoints(now_s)
        beat_s, loss_s = self._beat_s, self.settings.beat_loss_s
        if beat_s is not None and loss_s is not None and now_s - beat_s > loss_s:
            self._beat_s = None
            self._save("GCS Failsafe", now_s)
        if self.battery <= self.settings.battery_failsafe and not self._battery_called:
            self._battery_called = True
            self._save("Battery Failsafe: battery is low", now_s)
        flown_m = math.dist(self.body.position[:2], self.settings.home[:2])
        breached = flown_m > self.settings.fence_radius_m
        if breached and not self.fence_breached:
            self._save("Fence Breached", now_s)
        self.fence_breached = breached

    def _lose_setpoints(self, now_s: float) -> None:
        dialect = self.settings.dialect
        self._anchor, self._reference = self.body.position, None
        if dialect.autopilot is Autopilot.PX4:
            self._say(WARNING, "Failsafe: offboard control lost, holding")
            self._enter(dialect.hold, now_s)

    def _save(self, words: str, now_s: float) -> None:
        self._say(WARNING, words)
        dialect = self.settings.dialect
        if self.mode not in (dialect.return_home, dialect.land):
            self._enter(dialect.return_home, now_s)

    def _enter(self, mode: int, now_s: float) -> None:
        self.mode = mode
        self._anchor = self.body.position
        self._climb_to_m = self._reference = None
        self._say(INFORMATION, f"Mode {self.settings.dialect.name(mode)}")

    def _say(self, severity: int, text: str) -> None:
        self.spoken.append(Spoken(severity, text))
