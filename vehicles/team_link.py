"""The planner's end of the bus: observations come in, setpoints and knowledge go out.

Everything waits in inboxes until the mission's tick drains it; nothing happens to the mission
between ticks.
"""

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import Any

from pydantic import ValidationError

from solver.observations import (
    Attack,
    Detections,
    Link,
    Observation,
    RobotState,
    TrackReport,
)
from solver.setpoints import Setpoint
from vehicles import messages as wire
from vehicles import translation
from vehicles.bus import Bus, Subscription
from vehicles.inbox import Inbox, Sample, SampleKind
from vehicles.keys import TeamKeys, Topic
from vehicles.knowledge import Knowledge
from vehicles.link_monitor import LinkMonitor, LinkSettings, Standing
from vehicles.repetition import Repetition

logger = logging.getLogger(__name__)

FRESH_S = 1.0
"""Tracks that a robot brings are fused when they are no older."""

EVENTS_PER_TICK = 100
"""Events of one robot that one drain takes (a millisecond); a robot that floods delays itself."""

MAX_NOTICES = 1000
"""Notices that wait, and refusals that are told, at most."""

SPOKEN: Mapping[Topic, type[wire.State | wire.Detections | wire.Health | wire.Event]] = (
    MappingProxyType(
        {
            Topic.STATE: wire.State,
            Topic.DETECTIONS: wire.Detections,
            Topic.HEALTH: wire.Health,
            Topic.EVENTS: wire.Event,
        }
    )
)
STANDINGS: Mapping[Standing, str] = MappingProxyType(
    {
        Standing.UNKNOWN: "not of this team",
        Standing.DUPLICATE: "a second agent flies it; only the first is listened to",
    }
)


@dataclass(frozen=True, slots=True)
class Notice:
    """Something a robot, or the link, says that is for people rather than for the planner."""

    robot_id: int | None
    code: str
    """recovery, mode, duplicate, refused, dropped, unknown, or a vehicle's own code."""

    text: str
    time_s: float
    """Mission time."""


class TeamLink:
    """One team on a bus as its planner sees it. `async with`; the bus is not closed by it.

    Args:
        bus: Open.
        keys: The team's.
        robot_ids: The team; what others say is refused.
        boot: Names this run of the planner.
        clock: Monotonic, seconds.
        settings: When silence means what.
    """

    def __init__(
        self,
        bus: Bus,
        keys: TeamKeys,
        robot_ids: Iterable[int],
        boot: str,
        clock: Callable[[], float],
        settings: LinkSettings,
    ) -> None:
        self.refused = 0
        """Messages refused since the start: not valid, of unknown robots or of second runs."""

        self.unsaid = 0
        """Messages that could not be said because a number was out of bounds."""

        self._bus, self._keys, self._clock = bus, keys, clock
        self._refusals = Repetition(logger)
        self._losses = Repetition(logger)
        self._monitor = LinkMonitor(robot_ids, settings, clock())
        self._sender = translation.Sender(boot)
        self._latest = Inbox(keys.delivery)
        self._events = Inbox(keys.delivery, per_drain=EVENTS_PER_TICK)
        self._seqs: dict[str, tuple[str, int]] = {}
        self._notices: list[Notice] = []
        self._warned: set[tuple[int, str]] = set()
        self._dropped = 0
        self._truth: bytes | None = None
        self._healths: dict[int, wire.Health] = {}
        self._declared: list[Subscription] = []

    async def __aenter__(self) -> "TeamLink":
        for topic in (Topic.STATE, Topic.DETECTIONS, Topic.HEALTH):
            await self._subscribe(self._keys.robot(None, topic), self._latest)
        await self._subscribe(self._keys.truth, self._latest)
        await self._subscribe(self._keys.robot(None, Topic.EVENTS), self._events)
        self._declared.append(await self._bus.watch(self._keys.alive(None), self._events))
        return self

    async def __aexit__(self, *exception: object) -> None:
        declared, self._declared = self._declared, []
        for subscription in reversed(declared):
            await subscription.close()

    # ------------------------------------------------------------------ in

    def drain(self, time_s: float) -> tuple[Observation, ...]:
        """Return all that has arrived since the last call, and how robots are reached.

        Args:
            time_s: Mission time of the tick; ages are counted back from it.

        Returns:
            Link changes in team order, then what robots told (attacks, reports) in the order of
            arrival, then the newest state of each robot, then its newest detections.
        """
        now_s = self._clock()
        batch = _Batch()
        for sample in (*self._events.drain(), *self._latest.drain()):
            address = self._keys.parse(sample.key)
            if address is None:
                continue
            if address.topic is Topic.ALIVE and address.robot_id is not None:
                self._take_token(address.robot_id, sample)
            elif address.topic is Topic.TRUTH:
                self._truth = sample.payload
            elif address.robot_id is not None:
                self._take(address.topic, address.robot_id, sample, batch, (now_s, time_s))
        changes = self._monitor.changes(now_s)
        self._count_drops(time_s)
        return (*changes, *batch.told, *batch.states, *batch.seen)

    def take_notices(self) -> tuple[Notice, ...]:
        """Return what was said to people since the last call, oldest first."""
        notices, self._notices = tuple(self._notices), []
        return notices

    def health(self, robot_id: int) -> wire.Health | None:
        """Return what a robot last said of itself, None before it has."""
        return self._healths.get(robot_id)

    def link(self, robot_id: int) -> Link | None:
        """Return how a robot was reached at the last drain, None before anything is known."""
        return self._monitor.link(robot_id)

    def truth(self) -> wire.Truth | None:
        """Return the simulated world as last told, None when there is none.

        It is decoded when asked for: the tick does not pay for it.
        """
        if self._truth is None:
            return None
        try:
            return wire.decode(wire.Truth, self._truth)
        except wire.MessageError as error:
            self._refusals.warn(self._clock(), "the world's truth is refused: %s", error)
            self._truth = None
            return None

    # ------------------------------------------------------------------ out

    def send_setpoints(self, setpoints: Iterable[Setpoint], mission: str) -> None:
        """Send each robot its setpoint. Called by the tick itself and by nobody else."""
        for setpoint in setpoints:
            key = self._keys.robot(setpoint.robot_id, Topic.SETPOINT)
            make = partial(translation.setpoint_message, setpoint=setpoint, mission=mission)
            self._tell(key, make)

    def send_knowledge(self, *known: Knowledge) -> None:
        """Send each robot what it should know when it is cut off."""
        mates = translation.MateParts()
        for one in known:
            key = self._keys.robot(one.robot_id, Topic.KNOWLEDGE)
            self._tell(key, partial(translation.knowledge_message, known=one, mates=mates))

    def send_heartbeat(
        self, mission: str, tick: int, time_s: float, state: wire.PlannerState
    ) -> None:
        """Say that the tick is alive. Called by the tick itself and by nobody else."""
        key = self._keys.heartbeat
        header = self._sender.header(key, self._clock())
        message = wire.Heartbeat(**header, mission=mission, tick=tick, time_s=time_s, state=state)
        self._bus.publish(key, wire.encode(message))

    def control_world(self, action: wire.WorldAction, seed: int | None = None) -> None:
        """Pause, resume or reset the simulated world; nobody minds when there is none."""
        key = self._keys.control
        header = self._sender.header(key, self._clock())
        self._bus.publish(key, wire.encode(wire.WorldControl(**header, action=action, seed=seed)))

    # ------------------------------------------------------------------ inside

    @property
    def dropped(self) -> int:
        """Messages for which there was no room, since the start."""
        return self._latest.dropped + self._events.dropped

    def _tell(self, key: str, make: Callable[[dict[str, Any]], wire.Message]) -> None:
        """Send a message; one whose numbers are out of bounds is counted and not sent.

        Its robot then holds, or goes by what it knew, and the others fly on.
        """
        now_s = self._clock()
        try:
            message = make(self._sender.header(key, now_s))
        except ValidationError as error:
            self.unsaid += 1
            self._losses.warn(now_s, "not sent on %s: %s", key, error)
            return
        self._bus.publish(key, wire.encode(message))

    async def _subscribe(self, key_expr: str, inbox: Inbox) -> None:
        self._declared.append(await self._bus.subscribe(key_expr, inbox))

    def _take_token(self, robot_id: int, sample: Sample) -> None:
        if sample.kind is SampleKind.PUT:
            self._monitor.appeared(robot_id)
        else:
            self._monitor.disappeared(robot_id)

    def _take(
        self,
        topic: Topic,
        robot_id: int,
        sample: Sample,
        batch: "_Batch",
        times: tuple[float, float],
    ) -> None:
        """Decode and judge one message; put what it tells into the batch."""
        now_s, time_s = times
        kind = SPOKEN.get(topic)
        if kind is None:
            return
        if not self._monitor.knows(robot_id):
            # Unread: strangers by the thousand must not cost the tick their decoding.
            self._refuse_sender(robot_id, Standing.UNKNOWN, time_s)
            return
        try:
            message = wire.decode(kind, sample.payload)
        except wire.MessageError as error:
            self._refuse(robot_id, "refused", str(error), time_s)
            return
        if message.robot_id != robot_id:
            self._refuse(robot_id, "refused", "says another id than its key", time_s)
            return
        standing = self._monitor.heard(robot_id, message.boot, now_s)
        if standing is not Standing.KNOWN:
            self._refuse_sender(robot_id, standing, time_s)
            return
        self._warned.discard((robot_id, Standing.DUPLICATE.value))
        if not self._newer(sample.key, message):
            return
        match message:
            case wire.State():
                batch.states.append(translation.state_of(message))
            case wire.Detections():
                batch.seen.append(translation.detections_of(message))
            case wire.Event():
                batch.told.extend(self._told(message, time_s))
            case wire.Health():
                self._healths[robot_id] = message

    def _newer(self, key: str, message: wire.Message) -> bool:
        """Return whether a message is newer than the last one of its sender on its key."""
        last = self._seqs.get(key)
        if last is not None and last[0] == message.boot and message.seq <= last[1]:
            return False
        self._seqs[key] = (message.boot, message.seq)
        return True

    def _told(self, message: wire.Event, time_s: float) -> tuple[Attack | TrackReport, ...]:
        """Return what an event tells the planner; the rest becomes notices."""
        robot_id, at_s = message.robot_id, time_s - message.age_s
        match message.event:
            case wire.AttackPart() as part:
                return (translation.attack_of(robot_id, part, at_s),)
            case wire.ReturnPart() as part:
                report = translation.report_of(robot_id, part)
                if message.age_s > FRESH_S:
                    report = replace(report, tracks=())
                return (report,)
            case wire.RecoveryPart(kind=kind):
                self._say(robot_id, "recovery", f"{kind.value} works again", at_s)
            case wire.ModePart(mode=mode, reason=reason):
                self._say(robot_id, "mode", f"{mode.value}: {reason}", at_s)
            case wire.NoticePart(code=code, text=text):
                self._say(robot_id, code, text, at_s)
        return ()

    def _say(self, robot_id: int | None, code: str, text: str, time_s: float) -> None:
        if len(self._notices) < MAX_NOTICES:
            self._notices.append(Notice(robot_id, code, text, time_s))

    def _refuse_sender(self, robot_id: int, standing: Standing, time_s: float) -> None:
        words = f"robot {robot_id}: {STANDINGS[standing]}"
        self._refuse(robot_id, standing.value, words, time_s)

    def _refuse(self, robot_id: int, code: str, text: str, time_s: float) -> None:
        """Count a refusal; tell people of the first of its kind only."""
        self.refused += 1
        if (robot_id, code) in self._warned or len(self._warned) >= MAX_NOTICES:
            return
        self._warned.add((robot_id, code))
        logger.error("robot %d: %s", robot_id, text)
        self._say(robot_id, code, text, time_s)

    def _count_drops(self, time_s: float) -> None:
        dropped = self._latest.dropped + self._events.dropped
        if dropped > self._dropped:
            words = f"{dropped - self._dropped} messages were dropped: too many at once"
            logger.error(words)
            self._say(None, "dropped", words, time_s)
            self._dropped = dropped


@dataclass(slots=True)
class _Batch:
    """What one drain finds, by kind."""

    told: list[Attack | TrackReport] = field(default_factory=list)
    states: list[RobotState] = field(default_factory=list)
    seen: list[Detections] = field(default_factory=list)
