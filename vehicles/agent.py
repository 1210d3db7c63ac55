"""The agent: one per robot, the same for simulated and real vehicles.

It tells the team where the robot is and what it sees, flies the planner's setpoints for as long
as they live, and knows three silences apart: *jammed* (its own senses say so: it flies alone,
with its own filter and knowledge), *no planner* (nothing is heard, nothing jams: it holds),
*lost* (its process or its link is gone: its token disappears).
"""

import asyncio
import logging
from enum import StrEnum
from functools import partial

from solver.observations import Detections, RobotState
from solver.setpoints import Setpoint
from solver.zones import Point
from vehicles import messages as wire
from vehicles import translation
from vehicles.body import Body, BodyEvent, BodyEventKind, BodyState
from vehicles.bus import Bus, Subscription
from vehicles.guard import SetpointGuard
from vehicles.inbox import Inbox, Sample
from vehicles.keys import DOWNWARD, TeamKeys, Topic
from vehicles.onboard import OnboardPilot
from vehicles.onboard_flight import OnboardFlight
from vehicles.repetition import Repetition
from vehicles.reporter import Reporter
from vehicles.senses import Recovered, Senses, Struck
from vehicles.settings import AgentSettings

logger = logging.getLogger(__name__)

ORDERS_PER_STEP = 500
"""Orders that one step obeys; a flood of them must not keep the vehicle from holding."""

FLOWN = frozenset({wire.Mode.HOLDING, wire.Mode.FLYING})
"""Modes of a body in which it takes setpoints."""


class DuplicateRobotError(Exception):
    """Raised when another agent on the bus says it flies the same robot."""


class Alone(StrEnum):
    """Why a robot flies by itself."""

    JAMMED = "jammed"
    NO_PLANNER = "no planner"


class VehicleAgent:
    """Flies one robot. `start`, then `step` at the rate of the body (10 Hz), then `close`.

    Args:
        bus: Open; not closed by the agent.
        keys: The team's.
        body: What it flies.
        senses: What it notices.
        pilot: Flies alone when it must; this agent's own.
        boot: Names this run, 1 to 64 of A-Z a-z 0-9 _ -.
        settings: How it behaves.
    """

    def __init__(
        self,
        bus: Bus,
        keys: TeamKeys,
        body: Body,
        senses: Senses,
        pilot: OnboardPilot,
        boot: str,
        settings: AgentSettings,
    ) -> None:
        self.robot_id = pilot.robot_id
        self.mode = wire.Mode.HOLDING
        """What it flies by, as last told."""

        self._bus, self._keys, self._body, self._senses = bus, keys, body, senses
        self._settings = settings
        self._flight = OnboardFlight(pilot, settings.onboard_budget, settings.plan_wait_s)
        self._reporter = Reporter(bus, keys, self.robot_id, boot, settings.max_events)
        self._guard = SetpointGuard(self.robot_id)
        self._inbox = Inbox(keys.delivery, per_drain=ORDERS_PER_STEP)
        self._declared: list[Subscription] = []
        self._alone: Alone | None = None
        self._order: tuple[wire.Order, str] | None = None
        """The order in force and its id."""

        self._former: tuple[wire.Order, str] | None = None
        """What was in force before it."""

        self._heard_order: tuple[str, float] | None = None
        """Id of the newest order, and when it was heard."""

        self._started_s: float | None = None
        self._heartbeat_s: float | None = None
        self._conflict_s: float | None = None
        self._health_s: float | None = None
        self._taken = self._refused = 0
        self._layer_m: float | None = None
        """Altitude it was last sent to, which it keeps when it flies alone; metres."""

        self._refusals = Repetition(logger)

    async def start(self) -> None:
        """Announce the robot and listen.

        Raises:
            DuplicateRobotError: Somebody else flies this robot already.
            vehicles.bus.BusError: The bus is not open.
        """
        alive = self._keys.alive(self.robot_id)
        clock = asyncio.get_running_loop().time
        deadline = clock() + self._settings.duplicate_wait_s
        while await self._bus.present(alive):
            if clock() >= deadline:
                raise DuplicateRobotError(
                    f"robot {self.robot_id} of team {self._keys.team} is flown by another agent"
                )
            await asyncio.sleep(0.1)
        for key in (
            *(self._keys.robot(self.robot_id, topic) for topic in DOWNWARD),
            self._keys.robot(self.robot_id, Topic.STATE),
            self._keys.heartbeat,
        ):
            self._declared.append(await self._bus.subscribe(key, self._inbox))
        self._declared.append(await self._bus.announce(alive))

    async def close(self) -> None:
        """Stop listening and take the token back."""
        await self._flight.close()
        declared, self._declared = self._declared, []
        for subscription in reversed(declared):
            await subscription.close()

    async def step(self, now_s: float) -> None:
        """Do all that is due: listen, look, fly, tell.

        Args:
            now_s: This machine's monotonic clock.
        """
        if self._started_s is None:
            self._started_s = now_s
        for sample in self._inbox.drain():
            self._receive(sample, now_s)
        self._suffer(now_s)
        failures = self._senses.failures()
        jammed = failures.communication
        self._relink(Alone.JAMMED if jammed else self._left_alone(now_s), now_s)
        seen = None if failures.sensing else self._senses.detect(self._flight.targets)
        self._look(seen, now_s)
        state = self._body.state(now_s)
        if state is not None:
            self._note(state.position, now_s)
            await self._fly_alone(state, now_s)
            own = RobotState(
                robot_id=self.robot_id,
                position=state.position,
                velocity=state.velocity,
                altitude_m=state.altitude_m,
                sensing_failed=failures.sensing,
            )
            self._tell(state, own, now_s)
        # An event goes out right after a heartbeat came in: a link that has just died takes none
        # along.
        if not jammed and self._heartbeat_s == now_s:
            self._reporter.flush(now_s)
        elif not jammed and self._heard_order is not None and not self._hears_planner(now_s):
            # Somebody else gave the order, and waits.
            self._reporter.answer(self._heard_order[0], now_s)

    # ------------------------------------------------------------------ what is heard

    def _receive(self, sample: Sample, now_s: float) -> None:
        address = self._keys.parse(sample.key)
        if address is None:
            return
        try:
            match address.topic:
                case Topic.SETPOINT:
                    self._take_setpoint(wire.decode(wire.Setpoint, sample.payload), now_s)
                case Topic.KNOWLEDGE:
                    self._learn(wire.decode(wire.Knowledge, sample.payload), now_s)
                case Topic.COMMAND:
                    self._obey(wire.decode(wire.Command, sample.payload), now_s)
                case Topic.HEARTBEAT:
                    wire.decode(wire.Heartbeat, sample.payload)
                    self._heartbeat_s = now_s
                case Topic.STATE:
                    self._beware(wire.decode(wire.State, sample.payload), now_s)
                case _:
                    pass
        except wire.MessageError as error:
            self._refused += 1
            self._refusals.warn(now_s, "robot %d refuses a message: %s", self.robot_id, error)

    def _take_setpoint(self, message: wire.Setpoint, now_s: float) -> None:
        refusal = self._guard.refusal(message, now_s)
        if refusal is None and self._in_conflict(now_s):
            refusal = "another robot has this id"
        if refusal is not None:
            self._refused += 1
            logger.debug("robot %d refuses a setpoint: %s", self.robot_id, refusal)
            return
        self._taken += 1
        self._layer_m = message.altitude_m
        if not self._ordered and self.mode is not wire.Mode.MANUAL:
            self._body.follow(translation.setpoint_of(message), now_s)

    def _learn(self, message: wire.Knowledge, now_s: float) -> None:
        if message.robot_id != self.robot_id or self._alone is Alone.JAMMED:
            return
        known = translation.knowledge_of(message, now_s)
        self._flight.tell(lambda pilot: pilot.learn(known))

    def _obey(self, message: wire.Command, now_s: float) -> None:
        if message.robot_id != self.robot_id:
            return
        if self._heard_order is not None and message.command_id == self._heard_order[0]:
            return
        self._heard_order = (message.command_id, now_s)
        self._former, self._order = self._order, (message.command, message.command_id)
        logger.info("robot %d: %s, by %s", self.robot_id, message.command, message.author)
        self._body.order(message.command, now_s, message.command_id)

    @property
    def _ordered(self) -> bool:
        return self._order is not None and self._order[0] is not wire.Order.RESUME

    def _reconsider(self, refused: BodyEvent) -> None:
        """Let a take-off that was refused at once change nothing.

        Whatever else is refused, or fails later, was to end the flight: then it holds.
        """
        order, heard = self._order, self._heard_order
        if order is None or heard is None or order[0] is not wire.Order.TAKE_OFF:
            return
        if refused.order_id == order[1] and refused.at_s == heard[1]:
            self._order = self._former

    def _beware(self, message: wire.State, now_s: float) -> None:
        """Hold, loudly, when another robot speaks under this id."""
        if message.boot == self._reporter.boot:
            return
        if not self._in_conflict(now_s):
            text = f"another agent flies robot {self.robot_id}: holding"
            logger.error(text)
            self._reporter.note(now_s, partial(wire.NoticePart, code="duplicate", text=text))
            self._body.hold(now_s, text)
        self._conflict_s = now_s

    def _in_conflict(self, now_s: float) -> bool:
        since = self._conflict_s
        return since is not None and now_s - since <= self._settings.conflict_s

    # ------------------------------------------------------------------ what happens to it

    def _suffer(self, now_s: float) -> None:
        for event in self._body.take_events():
            logger.info("robot %d: %s: %s", self.robot_id, event.kind.value, event.text)
            if event.kind is BodyEventKind.REFUSED:
                self._reconsider(event)
            notice = partial(
                wire.NoticePart,
                code=event.kind.value,
                text=event.text[:200],
                command_id=event.order_id,
            )
            self._reporter.note(event.at_s, notice)
        for incident in self._senses.take_incidents():
            match incident:
                case Struck(kind=kind, zone=zone):
                    self._reporter.note(now_s, partial(translation.attack_part, kind, zone))
                    if zone is not None:
                        self._flight.reveal(zone)
                case Recovered(kind=kind):
                    self._reporter.note(now_s, partial(wire.RecoveryPart, kind=kind))

    def _hears_planner(self, now_s: float) -> bool:
        heard = self._heartbeat_s
        return heard is not None and now_s - heard <= self._settings.planner_silent_s

    def _left_alone(self, now_s: float) -> Alone | None:
        """Return whether it may fly by itself for want of a planner."""
        if self._heartbeat_s is None or self._hears_planner(now_s):
            return None
        silent_s = now_s - self._heartbeat_s - self._settings.planner_silent_s
        return Alone.NO_PLANNER if silent_s <= self._settings.autonomous_s else None

    def _relink(self, alone: Alone | None, now_s: float) -> None:
        """Notice that being alone begins or ends."""
        before, self._alone = self._alone, alone
        if alone is not None and before is None:
            self._flight.tell(lambda pilot: pilot.lost_link(now_s))
        elif alone is None and before is not None:
            self._flight.tell(
                lambda pilot: self._reporter.note(
                    now_s, lambda: translation.return_part(pilot.report(now_s))
                )
            )

    def _note(self, position: Point, now_s: float) -> None:
        """Let the pilot know where the link holds and where it does not."""
        heard = self._alone is None
        if heard or self._alone is Alone.JAMMED:
            self._flight.tell(lambda pilot: pilot.note(now_s, position, heard=heard))

    def _look(self, seen: Detections | None, now_s: float) -> None:
        if seen is None:
            return
        if self._alone is not None:
            self._flight.tell(lambda pilot: pilot.observe(seen))
        elif seen.sightings:
            self._reporter.detections(seen, now_s)

    async def _fly_alone(self, state: BodyState, now_s: float) -> None:
        grounded = self._ordered or self._in_conflict(now_s) or state.mode not in FLOWN
        if self._alone is None or grounded or not self._flight.alone:
            return
        planned = await self._flight.plan(now_s, state.position, state.velocity)
        if planned is None:
            return
        left_s = self._settings.onboard_ttl_s - planned.age_s
        if left_s <= 0.0:
            # It leads on from a place the robot may have left long ago.
            return
        if self._layer_m is None:
            self._layer_m = state.altitude_m
        setpoint = Setpoint(
            robot_id=self.robot_id,
            velocity=planned.velocity,
            waypoint=planned.waypoint,
            altitude_m=self._layer_m,
            ttl_s=left_s,
        )
        self._body.follow(setpoint, now_s)

    # ------------------------------------------------------------------ what it tells

    def _tell(self, state: BodyState, own: RobotState, now_s: float) -> None:
        mode = state.mode
        if mode is wire.Mode.FLYING and self._alone is not None and self._flight.alone:
            mode = wire.Mode.ONBOARD
        reason = self._explained(state, mode, now_s)
        if mode is not self.mode:
            part = partial(
                wire.ModePart,
                mode=mode,
                previous=self.mode,
                reason=reason,
                command_id=self._order[1] if self._ordered and self._order else None,
            )
            self._reporter.note(now_s, part)
            logger.info("robot %d: %s: %s", self.robot_id, mode.value, reason)
            self.mode = mode
        if state.age_s <= self._settings.stale_state_s:
            self._reporter.state(own, mode, now_s)
        if self._health_s is None or now_s - self._health_s >= self._settings.health_period_s:
            self._health_s = now_s
            self._tell_health(state, reason, now_s)

    def _explained(self, state: BodyState, mode: wire.Mode, now_s: float) -> str:
        """Return why it is in its mode, with the silence that causes it."""
        if mode is wire.Mode.ONBOARD:
            return f"{self._alone}: flying alone"
        if mode is wire.Mode.HOLDING and not self._ordered:
            if self._in_conflict(now_s):
                return "another robot has this id"
            if self._alone is not None:
                return f"{self._alone}, and no plan to fly by"
            if not self._hears_planner(now_s):
                return "no planner is heard"
            if not self._taken:
                return "the planner sends it nothing: is it of this team?"
        return state.reason[:200]

    def _tell_health(self, state: BodyState, reason: str, now_s: float) -> None:
        heartbeat_s, started_s = self._heartbeat_s, self._started_s
        fields = {
            "mode": self.mode,
            "reason": reason,
            "uptime_s": 0.0 if started_s is None else now_s - started_s,
            "battery": state.battery,
            "heartbeat_age_s": None if heartbeat_s is None else now_s - heartbeat_s,
            "setpoints": self._taken,
            "refused": self._refused + self._reporter.unsaid,
            "dropped": self._inbox.dropped + self._reporter.dropped,
            "plan_s": self._flight.plan_s,
        }
        self._reporter.health(fields, now_s)
