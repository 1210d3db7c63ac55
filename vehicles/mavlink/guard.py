"""Who flies the vehicle, and what may reach it: a state machine without any I/O.

The guard lets setpoints through only while the vehicle follows us, its link and position are
fresh and the setpoint is alive and inside the limits. The moment somebody else changes the mode
it lets go: no setpoint, no request, until an operator says `resume` or the vehicle is put back
into the following mode by the one who took it. Everything it decides is told once.
"""

from dataclasses import dataclass
from enum import StrEnum

from solver.setpoints import Setpoint
from vehicles.body import BodyEvent, BodyEventKind
from vehicles.mavlink import undertakings
from vehicles.mavlink.alarms import Alarm, Watch
from vehicles.mavlink.commands import Action, Beat, Disarm, Target
from vehicles.mavlink.dialects import Dialect
from vehicles.mavlink.frames import Alignment, Vector
from vehicles.mavlink.limits import FlightLimits, Leg
from vehicles.mavlink.telemetry import Telemetry
from vehicles.mavlink.undertakings import Undertaking
from vehicles.messages import Mode, Order

LINK_LOST_S = 2.0
"""Without any word of the autopilot for so long, the link is lost; its streams come at 10 Hz and
more, so half of them may be lost on the way."""

MODE_LOST_S = 10.0
"""Without a heartbeat for so long nobody knows who flies, whatever else is heard."""

RETURNED_S = 2.0
"""A mode found changed within so long of the link's return was changed in silence."""

POSITION_LOST_S = 1.0
TARGET_PERIOD_S = 0.1
BEAT_PERIOD_S = 1.0
_EARLY_S = 0.01
"""A tick this much early still counts: ticks jitter, rates should not halve."""


class Control(StrEnum):
    """Whose word the vehicle follows."""

    STANDBY = "standby"
    """Not ours, and never taken from us."""

    FOLLOWING = "following"
    LEAVING = "leaving"
    """Landing or returning by itself, on our order."""

    RELEASED = "released"
    """Taken from us, by a pilot or by its autopilot."""


class TakeOffRule(StrEnum):
    """Whether an operator's order to arm and take off is carried out."""

    FORBIDDEN = "forbidden"
    ALLOWED = "allowed"


@dataclass(frozen=True, slots=True)
class GuardSettings:
    """What the guard goes by."""

    dialect: Dialect
    limits: FlightLimits
    take_off: TakeOffRule = TakeOffRule.FORBIDDEN
    take_off_altitude_m: float = 2.0
    """In the common frame."""


class Guard:
    """Decides what is sent to one vehicle. Reads its `Telemetry`, which it does not own."""

    def __init__(self, settings: GuardSettings, telemetry: Telemetry) -> None:
        self.control = Control.STANDBY
        self.reason = "not yet heard of"
        self.refused = 0
        self._settings = settings
        self._told = telemetry
        self._watch = Watch(settings.limits.battery_least)
        self._events: list[BodyEvent] = []
        self._undertaking: Undertaking | None = None
        self._expected: frozenset[int] = frozenset()
        self._wanted: int | None = None
        self._leaving_id: str | None = None
        self._leg: Leg | None = None
        self._hold_at: Vector | None = None
        self._held = False
        self._commanded = False
        self._linked = False
        self._back_s = float("-inf")
        self._placed = True
        self._objected = False
        self._target_s = float("-inf")
        self._beat_s = float("-inf")

    # ------------------------------------------------------------------ what comes in

    def follow(self, setpoint: Setpoint, alignment: Alignment | None, now_s: float) -> None:
        """Take a setpoint, or refuse it and keep the one before until that expires."""
        objection = "its place in the common frame is not known"
        start = None
        if alignment is not None and self._fresh_position(now_s):
            start = alignment.to_common(self._told.position_at(now_s))[:2]
            objection = self._settings.limits.objection(setpoint, start) or ""
        if start is None or objection:
            self.refused += 1
            if not self._objected:
                self._tell(BodyEventKind.REFUSED, f"setpoint refused: {objection}", now_s)
            self._objected = True
            return
        self._objected = False
        self._commanded = True
        self._hold_at = None
        if self.control is Control.FOLLOWING and not self._held:
            self.reason = "following the planner"
        self._leg = Leg(setpoint, start, now_s)

    def stop(self, now_s: float, reason: str) -> None:
        """Hold where it is until the next setpoint."""
        self._leg = None
        self._hold_at = None
        if self.control is Control.FOLLOWING:
            self.reason = reason

    def order(self, order: Order, alignment: Alignment | None, now_s: float, order_id: str) -> None:
        """Take an operator's order."""
        objection = self._objection(order, alignment)
        if objection is not None:
            self._tell(BodyEventKind.REFUSED, f"{order.value}: {objection}", now_s, order_id)
            return
        self._commanded = True
        dialect = self._settings.dialect
        if order is Order.HOLD:
            self._held = True
            self._leg = self._hold_at = None
            self.reason = "held by an operator"
            self._tell(BodyEventKind.DONE, "holding", now_s, order_id)
        elif order is Order.RESUME:
            self._held = False
            if self.control is Control.FOLLOWING:
                self.reason = "following the planner"
                self._tell(BodyEventKind.DONE, "following the planner", now_s, order_id)
            else:
                begun = undertakings.engage(dialect, order, order_id, now_s)
                self._begin(begun, dialect.follow, now_s)
        elif order is Order.TAKE_OFF and alignment is not None:
            height = (0.0, 0.0, self._settings.take_off_altitude_m)
            climb_m = alignment.to_local(height)[2]
            self._held = False
            begun = undertakings.take_off(dialect, climb_m, order_id, now_s)
            self._begin(begun, dialect.follow, now_s)
        else:
            mode = dialect.land if order is Order.LAND else dialect.return_home
            begun = undertakings.leave(mode, dialect, order, order_id, now_s)
            self._begin(begun, mode, now_s)

    def answer(self, command: int, result: int, now_s: float) -> None:
        """Take an acknowledgement of the autopilot."""
        if self._undertaking is not None:
            self._undertaking.answer(command, result, now_s)

    def beware(self, stranger: int, system: int, now_s: float) -> None:
        """Tell that another system than the vehicle speaks on its link."""
        words = f"system {stranger} speaks on the link; only system {system} is listened to"
        self._tell(BodyEventKind.STRANGER, words, now_s)

    def take_events(self) -> tuple[BodyEvent, ...]:
        """Return what has happened since the last call, oldest first."""
        events, self._events = tuple(self._events), []
        return events

    # ------------------------------------------------------------------ what goes out

    def tick(self, alignment: Alignment | None, now_s: float) -> list[Action]:
        """Return what to send now; call it at least as often as targets are to flow."""
        for alarm, words in self._watch.look(self._told, now_s):
            self._tell(_EVENT_OF[alarm], words, now_s)
        if not self._link(now_s):
            return []
        self._look_at_mode(now_s)
        self._look_at_position(now_s)
        actions = self._advance(now_s)
        if self._streams() and now_s - self._target_s >= TARGET_PERIOD_S - _EARLY_S:
            target = self._target(alignment, now_s)
            if target is not None:
                self._target_s = now_s
                actions.append(target)
        if self._alive(now_s) and now_s - self._beat_s >= BEAT_PERIOD_S - _EARLY_S:
            self._beat_s = now_s
            actions.append(Beat())
        return actions

    def mode(self, now_s: float) -> Mode:
        """Return what the vehicle flies by, in the team's words."""
        dialect, undertaking = self._settings.dialect, self._undertaking
        if undertaking is not None and undertaking.order is Order.TAKE_OFF and self._told.armed:
            return Mode.CLIMBING
        if not self._told.airborne:
            return Mode.LANDED
        if self.control is Control.FOLLOWING:
            return Mode.FLYING if self._alive(now_s) and not self._held else Mode.HOLDING
        if self._told.mode == dialect.land:
            return Mode.LANDING
        if self._told.mode == dialect.return_home:
            return Mode.RETURNING
        return Mode.HOLDING if self._told.mode == dialect.hold else Mode.MANUAL

    # ------------------------------------------------------------------ who flies

    def _link(self, now_s: float) -> bool:
        heard_s, beat_s = self._told.heard_s, self._told.heartbeat_s
        fresh = (
            heard_s is not None
            and beat_s is not None
            and now_s - heard_s <= LINK_LOST_S
            and now_s - beat_s <= MODE_LOST_S
        )
        if fresh and not self._linked:
            self._back_s = now_s
            self._tell(BodyEventKind.LINK_BACK, "the autopilot is heard", now_s)
            if self.control is Control.STANDBY:
                self.reason = "waiting for an operator"
        elif self._linked and not fresh:
            self._tell(BodyEventKind.LINK_LOST, "the autopilot has fallen silent", now_s)
        self._linked = fresh
        return fresh

    def _look_at_mode(self, now_s: float) -> None:
        mode, dialect = self._told.mode, self._settings.dialect
        if mode is None:
            return
        followed = self.control in (Control.FOLLOWING, Control.LEAVING)
        if followed and not self._told.airborne:
            # A landed vehicle must not be streamed to: armed again, some would take off.
            begun = self._undertaking
            if begun is not None and begun.order in (Order.LAND, Order.RETURN):
                # Down before its heartbeat has told of the mode.
                self._undertaking = None
                self._tell(BodyEventKind.DONE, "landed", now_s, begun.order_id)
            elif self.control is Control.LEAVING:
                self._tell(BodyEventKind.DONE, "landed", now_s, self._leaving_id)
            self.control, self.reason = Control.STANDBY, "landed"
            followed = False
        ours = followed or self._undertaking is not None
        if ours and mode not in self._expected:
            self._let_go(mode, now_s)
        elif ours and mode == self._wanted:
            self._expected = frozenset({mode})
        elif not ours and mode == dialect.follow and self._told.airborne:
            self._take_control(now_s)

    def _let_go(self, mode: int, now_s: float) -> None:
        explained = self._watch.acts(now_s) or now_s - self._back_s <= RETURNED_S
        saved = mode in self._settings.dialect.savers and explained
        kind = BodyEventKind.FAILSAFE if saved else BodyEventKind.PILOT
        who = "its failsafe" if saved else "a pilot"
        self.reason = f"{who} changed the mode to {self._settings.dialect.name(mode)}"
        begun = self._undertaking
        self._tell(kind, self.reason, now_s, None if begun is None else begun.order_id)
        self.control = Control.RELEASED
        self._expected = frozenset()
        self._undertaking = self._leg = self._hold_at = None

    def _take_control(self, now_s: float) -> None:
        self.control, self.reason = Control.FOLLOWING, "following the planner"
        self._expected = frozenset({self._settings.dialect.follow})
        self._hold_at = None
        self._tell(BodyEventKind.CONTROL, "the vehicle follows us", now_s)

    # ------------------------------------------------------------------ orders

    def _objection(self, order: Order, alignment: Alignment | None) -> str | None:
        """Return why an order cannot be carried out now."""
        airborne, ours = self._told.airborne, self.control is Control.FOLLOWING
        if not self._linked:
            return "the autopilot is not heard"
        if order is Order.TAKE_OFF:
            if self._settings.take_off is TakeOffRule.FORBIDDEN:
                return "taking off is not allowed here"
            if alignment is None:
                return "the vehicle's place in the common frame is not known"
            return "it flies already" if airborne else None
        if not airborne:
            return "it is on the ground"
        if order is Order.HOLD and not ours:
            return "it does not follow us"
        if self.control is Control.RELEASED and order is not Order.RESUME:
            return "a pilot or its failsafe flies it"
        return None

    def _begin(self, undertaking: Undertaking, mode: int, now_s: float) -> None:
        if (begun := self._undertaking) is not None:
            words = f"{begun.order.value}: given up for {undertaking.order.value}"
            self._tell(BodyEventKind.REFUSED, words, now_s, begun.order_id)
        self._undertaking = undertaking
        now = frozenset() if self._told.mode is None else frozenset({self._told.mode})
        self._expected, self._wanted = now | {mode}, mode
        self._leg = self._hold_at = None

    def _advance(self, now_s: float) -> list[Action]:
        begun = self._undertaking
        if begun is None:
            return []
        action = begun.advance(self._told, now_s)
        if begun.failure is not None:
            return self._fail(begun, begun.failure, now_s)
        if begun.done:
            self._finish(begun, now_s)
        return [] if action is None else [action]

    def _finish(self, begun: Undertaking, now_s: float) -> None:
        self._undertaking = None
        if begun.order in (Order.LAND, Order.RETURN):
            self.control, self._leaving_id = Control.LEAVING, begun.order_id
            self.reason = f"ordered to {begun.order.value}"
            return
        words = "in the air" if begun.order is Order.TAKE_OFF else "taking setpoints again"
        self._tell(BodyEventKind.DONE, words, now_s, begun.order_id)
        hold_at = self._hold_at
        if self.control is not Control.FOLLOWING:
            self._take_control(now_s)
        # It climbs on to where it was sent: the last tenth of a take-off is not lost.
        self._hold_at = hold_at

    def _fail(self, begun: Undertaking, failure: str, now_s: float) -> list[Action]:
        self._undertaking = None
        self._tell(BodyEventKind.REFUSED, failure, now_s, begun.order_id)
        follow = self._settings.dialect.follow
        self._expected = frozenset({follow}) if self.control is Control.FOLLOWING else frozenset()
        grounded = self._told.armed and not self._told.airborne
        return [Disarm()] if begun.order is Order.TAKE_OFF and grounded else []

    # ------------------------------------------------------------------ setpoints

    def _alive(self, now_s: float) -> bool:
        """Tell whether the planner's setpoints are alive."""
        return self._leg is not None and now_s < self._leg.until_s

    def _streams(self) -> bool:
        """Tell whether targets are to flow: to follow, or to be allowed to.

        Not before a planner or an operator has said a word: what is heard on the link alone never
        makes a setpoint.
        """
        if self._undertaking is not None:
            return self._undertaking.order in (Order.RESUME, Order.TAKE_OFF)
        return self.control is Control.FOLLOWING and self._commanded

    def _target(self, alignment: Alignment | None, now_s: float) -> Target | None:
        if not self._fresh_position(now_s):
            return None
        leg = self._leg
        if (
            leg is not None
            and alignment is not None
            and self._alive(now_s)
            and not self._held
            and self._undertaking is None
        ):
            place, velocity = leg.reference(now_s + self._settings.dialect.lead_s)
            return Target(alignment.to_local(place), alignment.turned_back(velocity))
        return Target(self._hold_place(alignment, now_s), (0.0, 0.0, 0.0))

    def _hold_place(self, alignment: Alignment | None, now_s: float) -> Vector:
        """Return where to hold: where it was when holding began, or above it on taking off."""
        if self._hold_at is None:
            x, y, z = self._told.position
            begun = self._undertaking
            if begun is not None and begun.order is Order.TAKE_OFF and alignment is not None:
                z = alignment.to_local((0.0, 0.0, self._settings.take_off_altitude_m))[2]
            elif self._leg is not None and not self._held:
                self.reason = "the planner's setpoints have expired"
            self._hold_at = (x, y, z)
        return self._hold_at

    def _fresh_position(self, now_s: float) -> bool:
        at_s = self._told.position_s
        return at_s is not None and now_s - at_s <= POSITION_LOST_S

    def _look_at_position(self, now_s: float) -> None:
        fresh = self._fresh_position(now_s)
        if self._placed and not fresh and self._told.position_s is not None:
            self._tell(BodyEventKind.POSITION_LOST, "it no longer tells where it is", now_s)
        self._placed = fresh or self._told.position_s is None

    def _tell(
        self, kind: BodyEventKind, text: str, now_s: float, order_id: str | None = None
    ) -> None:
        self._events.append(BodyEvent(kind, text, now_s, order_id))


_EVENT_OF = {
    Alarm.BATTERY: BodyEventKind.BATTERY,
    Alarm.FENCE: BodyEventKind.GEOFENCE,
    Alarm.FAILSAFE: BodyEventKind.WARNING,
}
