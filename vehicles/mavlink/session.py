"""One vehicle over MAVLink without any I/O: datagrams in, datagrams out, time as an argument."""

from collections.abc import Iterable
from dataclasses import dataclass

from solver.setpoints import Setpoint
from vehicles.body import BodyEvent, BodyEventKind, BodyState
from vehicles.mavlink.alignment import Aligner
from vehicles.mavlink.codec import AUTOPILOT, COMPANION, Codec, Counts
from vehicles.mavlink.commands import message_of, stream_requests
from vehicles.mavlink.guard import Guard, GuardSettings
from vehicles.mavlink.noise import NoiseWatch
from vehicles.mavlink.protocol import Message
from vehicles.mavlink.signing import SigningKey
from vehicles.mavlink.tags import KIND, TagWatcher, sighting_of
from vehicles.mavlink.telemetry import Telemetry
from vehicles.mavlink.validation import PLAUSIBLE, plausible
from vehicles.messages import Order

OUR_SYSTEM = 245
"""System id we speak with; ground stations use 255."""

REQUEST_PERIOD_S = 5.0
"""How often streams that do not flow are asked for."""

KNOCK_PERIOD_S = 1.0
"""How often a silent vehicle is spoken to."""

STALE_S = 2.0
"""A stream not seen for so long does not flow."""


@dataclass(frozen=True, slots=True)
class SessionSettings:
    """Who flies whom, and how."""

    guard: GuardSettings
    system: int
    """System id of the vehicle. Frames of any other are refused."""

    own_system: int = OUR_SYSTEM
    own_component: int = COMPANION

    def __post_init__(self) -> None:
        """Check the ids.

        Raises:
            ValueError: An id is none, or both are the same party.
        """
        ids = (self.system, self.own_system, self.own_component)
        if not all(1 <= number <= 255 for number in ids):
            raise ValueError("MAVLink ids lie between 1 and 255")
        if self.system == self.own_system and self.own_component == AUTOPILOT:
            raise ValueError("we cannot be the autopilot we fly")


class Session:
    """The vehicle as heard and spoken to over one link."""

    def __init__(
        self,
        settings: SessionSettings,
        aligner: Aligner,
        key: SigningKey | None = None,
        tags: TagWatcher | None = None,
    ) -> None:
        self.telemetry = Telemetry()
        self.guard = Guard(settings.guard, self.telemetry)
        self._settings = settings
        self._aligner = aligner
        self._tags = tags
        self._events: list[BodyEvent] = []
        self._noise = NoiseWatch()
        self._codec = Codec(settings.own_system, settings.own_component, settings.system, key)
        self._started_s: float | None = None
        self._requested_s = float("-inf")
        self._dialect = settings.guard.dialect

    @property
    def counts(self) -> Counts:
        """Frames accepted and refused so far."""
        return self._codec.counts

    def receive(self, datagram: bytes, now_s: float) -> bool:
        """Take a datagram; tell whether the autopilot's heartbeat was in it. Never raises."""
        heard, known = False, self._codec.stranger
        for message in self._codec.decode(datagram, now_s):
            if message.get_type() == KIND:
                self._sight(message, now_s)
            elif message.get_srcComponent() == AUTOPILOT:
                heard |= self._take(message, now_s)
        if known is None and self._codec.stranger is not None:
            self.guard.beware(self._codec.stranger, self._settings.system, now_s)
        return heard

    def _sight(self, message: Message, now_s: float) -> None:
        """Take a tag that the vehicle's camera has seen, whichever component tells of it."""
        if self._tags is None:
            return
        if not plausible(message):
            self._codec.counts.implausible += 1
            return
        sighting = sighting_of(message)
        if sighting is None:
            return
        placed = self._aligner.alignment is not None
        self._tags.sight(sighting, now_s)
        if placed and self._aligner.alignment is None:
            lost = BodyEvent(BodyEventKind.POSITION_LOST, self._tags.reason, now_s)
            self._events.append(lost)

    def _take(self, message: Message, now_s: float) -> bool:
        kind = message.get_type()
        if kind not in PLAUSIBLE:
            return False
        if not plausible(message):
            self._codec.counts.implausible += 1
            return False
        if kind == "HEARTBEAT" and message.autopilot not in self._dialect.identities:
            self._codec.counts.implausible += 1
            return False
        if kind == "COMMAND_ACK":
            if message.target_system in (0, self._settings.own_system):
                self.guard.answer(message.command, message.result, now_s)
            return False
        self.telemetry.receive(message, now_s)
        self._aligner.observe(self.telemetry)
        return bool(kind == "HEARTBEAT")

    def tick(self, now_s: float) -> list[bytes]:
        """Return the frames to send now, one datagram each."""
        if self._started_s is None:
            self._started_s = now_s
        if (words := self._noise.look(self._codec.counts, now_s)) is not None:
            self._events.append(BodyEvent(BodyEventKind.NOISE, words, now_s))
        boot_ms = int((now_s - self._started_s) * 1000.0)
        messages = [
            message_of(action, self._dialect, self._settings.system, boot_ms)
            for action in self.guard.tick(self._aligner.alignment, now_s)
        ]
        return self._encoded([*self._requests(now_s), *messages], now_s)

    def follow(self, setpoint: Setpoint, now_s: float) -> None:
        """Take a setpoint of the planner."""
        self.guard.follow(setpoint, self._aligner.alignment, now_s)

    def stop(self, now_s: float, reason: str) -> None:
        """Hold until the next setpoint."""
        self.guard.stop(now_s, reason)

    def order(self, order: Order, now_s: float, order_id: str) -> None:
        """Take an operator's order."""
        self.guard.order(order, self._aligner.alignment, now_s, order_id)

    def take_events(self) -> tuple[BodyEvent, ...]:
        """Return what has happened since the last call."""
        own, self._events = self._events, []
        return (*self.guard.take_events(), *own)

    def state(self, now_s: float) -> BodyState | None:
        """Return the vehicle in the common frame, None until its place there is known."""
        told, alignment = self.telemetry, self._aligner.alignment
        if alignment is None or told.position_s is None:
            return None
        x, y, z = alignment.to_common(told.position)
        east, north, _ = alignment.turned(told.velocity)
        return BodyState(
            position=(x, y),
            velocity=(east, north),
            altitude_m=z,
            mode=self.guard.mode(now_s),
            reason=self.guard.reason,
            armed=told.armed,
            battery=told.battery,
            age_s=max(now_s - told.position_s, 0.0),
        )

    def _requests(self, now_s: float) -> list[Message]:
        """Return requests for streams that do not flow; to a silent vehicle only a knock.

        A vehicle that listens on a port of its own must hear from us before it can speak to us.
        """
        told = self.telemetry
        if told.heard_s is None or now_s - told.heard_s > STALE_S:
            if now_s - self._requested_s < KNOCK_PERIOD_S:
                return []
            self._requested_s = now_s
            return stream_requests(self._settings.system)[-1:]
        flowing = [told.position_s, told.attitude_s]
        stale = any(at_s is None or now_s - at_s > STALE_S for at_s in flowing)
        missing = stale or self._aligner.alignment is None
        if not missing or now_s - self._requested_s < REQUEST_PERIOD_S:
            return []
        self._requested_s = now_s
        return stream_requests(self._settings.system)

    def _encoded(self, messages: Iterable[Message], now_s: float) -> list[bytes]:
        return [self._codec.encode(message, now_s) for message in messages]
