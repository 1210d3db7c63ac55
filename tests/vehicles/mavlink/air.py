"""A vehicle, its bridge and the air between them in virtual time."""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from solver.setpoints import Setpoint
from vehicles.body import BodyEvent, BodyEventKind
from vehicles.mavlink.alignment import Aligner, DatumAlignment
from vehicles.mavlink.autopilot import AutopilotSettings, SimulatedAutopilot
from vehicles.mavlink.codec import Codec
from vehicles.mavlink.dialects import DIALECTS, Autopilot, Dialect
from vehicles.mavlink.flight import FlightSettings, Start
from vehicles.mavlink.frames import Datum
from vehicles.mavlink.guard import GuardSettings, TakeOffRule
from vehicles.mavlink.limits import FlightLimits
from vehicles.mavlink.session import Session, SessionSettings
from vehicles.mavlink.tags import TagWatcher
from vehicles.messages import Mode

STEP_S = 0.02
ORIGIN = Datum(47.3769, 8.5417, 410.0)

Filter = Callable[[bytes, float], list[bytes]]


def whole(datagram: bytes, now_s: float) -> list[bytes]:
    """Air that loses nothing."""
    return [datagram]


@dataclass
class Air:
    """Autopilot and session, stepped together; `up` and `down` may lose or change datagrams."""

    autopilot: SimulatedAutopilot
    session: Session
    now_s: float = 100.0
    up: Filter = whole
    """From the vehicle to the bridge."""

    down: Filter = whole
    events: list[BodyEvent] = field(default_factory=list)
    sent: list[tuple[float, bytes]] = field(default_factory=list)
    """Everything the bridge has sent."""

    def run(self, seconds: float, each: Callable[[float], None] | None = None) -> None:
        """Let time pass; `each` is called at every step of 20 ms."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            self.now_s += STEP_S
            if each is not None:
                each(self.now_s)
            for frame in self.autopilot.tick(self.now_s):
                self._up(frame)
            for frame in self.session.tick(self.now_s):
                self.sent.append((self.now_s, frame))
                for heard in self.down(frame, self.now_s):
                    for answer in self.autopilot.receive(heard, self.now_s):
                        self._up(answer)
            self.events += self.session.take_events()

    def _up(self, frame: bytes) -> None:
        for heard in self.up(frame, self.now_s):
            self.session.receive(heard, self.now_s)

    def count(self, kind: BodyEventKind) -> int:
        """Return how often a kind of event has happened."""
        return sum(event.kind is kind for event in self.events)

    def flown(self, seconds: float, setpoint: Callable[[float], Setpoint]) -> None:
        """Let time pass with a planner that sends a setpoint ten times a second."""
        due_s = self.now_s

        def plan(now_s: float) -> None:
            nonlocal due_s
            if now_s >= due_s - 1e-9:
                due_s += 0.1
                self.session.follow(setpoint(now_s), now_s)

        self.run(seconds, plan)


def dialect_of(autopilot: Autopilot) -> Dialect:
    return DIALECTS[autopilot]


def flying(autopilot: Autopilot = Autopilot.ARDUPILOT, **flight: Any) -> Air:
    """Return an airborne vehicle in the following mode and a bridge to it."""
    return build(autopilot, start=Start.AIRBORNE, **flight)


def build(
    autopilot: Autopilot = Autopilot.ARDUPILOT,
    aligner: Aligner | None = None,
    take_off: TakeOffRule = TakeOffRule.FORBIDDEN,
    limits: FlightLimits | None = None,
    system: int = 7,
    tags: TagWatcher | None = None,
    **flight: Any,
) -> Air:
    """Return a vehicle and a bridge to it that have not yet heard of each other."""
    dialect = DIALECTS[autopilot]
    settings = AutopilotSettings(
        flight=FlightSettings(dialect=dialect, **flight),
        system=system,
        origin=ORIGIN,
    )
    guard = GuardSettings(dialect, limits or FlightLimits(), take_off)
    chosen = aligner or DatumAlignment(ORIGIN)
    session = Session(SessionSettings(guard, system=system), chosen, tags=tags)
    return Air(SimulatedAutopilot(settings), session)


def eastward(air: Air, speed_m_s: float = 1.0) -> Callable[[float], Setpoint]:
    """Return a planner that sends the robot east at a constant speed."""

    def plan(now_s: float) -> Setpoint:
        state = air.session.state(now_s)
        x, y = (0.0, 0.0) if state is None else state.position
        return Setpoint(7, (speed_m_s, 0.0), (x + 0.5 * speed_m_s, y), 2.0, 0.5)

    return plan


def kinds_sent(air: Air, since_s: float = 0.0) -> Counter[str]:
    """Count the kinds of message the bridge has sent."""
    reader = Codec(1, 1, None, None)
    return Counter(
        message.get_type()
        for at_s, frame in air.sent
        if at_s > since_s
        for message in reader.decode(frame, at_s)
    )


def mode(air: Air) -> Mode:
    state = air.session.state(air.now_s)
    assert state is not None
    return state.mode


def speed(air: Air) -> float:
    return math.hypot(*air.autopilot.flight.body.velocity)
