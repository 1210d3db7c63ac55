"""What an agent tells the team: state, detections, health, and events that wait to be heard."""

import logging
from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

from pydantic import ValidationError

from solver.observations import Detections, RobotState
from vehicles import messages as wire
from vehicles import translation
from vehicles.bus import Bus
from vehicles.keys import TeamKeys, Topic

logger = logging.getLogger(__name__)

Part: TypeAlias = (
    wire.AttackPart | wire.RecoveryPart | wire.ModePart | wire.ReturnPart | wire.NoticePart
)


class Reporter:
    """Owner of what one robot has told and still has to tell.

    Args:
        bus: Open.
        keys: The team's.
        robot_id: Who speaks.
        boot: Names this run.
        max_events: So many wait at most; the oldest go first and are counted.
    """

    def __init__(self, bus: Bus, keys: TeamKeys, robot_id: int, boot: str, max_events: int) -> None:
        self.robot_id = robot_id
        self.boot = boot
        self.unsaid = 0
        """Messages that could not be said because a number was out of bounds."""

        self.dropped = 0
        """Events that waited too long behind too many others."""

        self._bus, self._keys = bus, keys
        self._sender = translation.Sender(boot)
        self._max_events = max_events
        self._pending: deque[tuple[float, Part]] = deque()

    def state(self, state: RobotState, mode: wire.Mode, now_s: float) -> None:
        """Tell where the robot is."""
        self._publish(
            Topic.STATE, lambda header: translation.state_message(header, state, mode), now_s
        )

    def detections(self, seen: Detections, now_s: float) -> None:
        """Tell what it sees."""
        self._publish(
            Topic.DETECTIONS, lambda header: translation.detections_message(header, seen), now_s
        )

    def health(self, fields: dict[str, Any], now_s: float) -> None:
        """Tell how it is: the fields of the message but the common ones and the id."""
        self._publish(
            Topic.HEALTH,
            lambda header: wire.Health(**header, robot_id=self.robot_id, **fields),
            now_s,
        )

    def note(self, at_s: float, make: Callable[[], Part]) -> None:
        """Let an event wait until it can be heard. A newer return replaces one that waits.

        Args:
            at_s: When it happened, on this machine's monotonic clock.
            make: Makes its words; what cannot be said is counted (`unsaid`).
        """
        try:
            part = make()
        except ValidationError as error:
            self._leave_unsaid(Topic.EVENTS, error)
            return
        if isinstance(part, wire.ReturnPart):
            kept = (one for one in self._pending if not isinstance(one[1], wire.ReturnPart))
            self._pending = deque(kept)
        if len(self._pending) >= self._max_events:
            self._pending.popleft()
            self.dropped += 1
        self._pending.append((at_s, part))

    def flush(self, now_s: float) -> None:
        """Tell every event that waits, oldest first, with its age."""
        while self._pending:
            at_s, part = self._pending.popleft()
            self._event(part, max(0.0, now_s - at_s), now_s)

    def answer(self, command_id: str, now_s: float) -> None:
        """Tell only what waits to be told of one order."""
        waiting, self._pending = self._pending, deque()
        for at_s, part in waiting:
            if isinstance(part, wire.NoticePart) and part.command_id == command_id:
                self._event(part, max(0.0, now_s - at_s), now_s)
            else:
                self._pending.append((at_s, part))

    def _event(self, part: Part, age_s: float, now_s: float) -> None:
        self._publish(
            Topic.EVENTS,
            lambda header: wire.Event(**header, robot_id=self.robot_id, age_s=age_s, event=part),
            now_s,
        )

    def _publish(
        self, topic: Topic, make: Callable[[dict[str, Any]], wire.Message], now_s: float
    ) -> None:
        key = self._keys.robot(self.robot_id, topic)
        try:
            message = make(self._sender.header(key, now_s))
        except ValidationError as error:
            self._leave_unsaid(topic, error)
            return
        self._bus.publish(key, wire.encode(message))

    def _leave_unsaid(self, topic: Topic, error: ValidationError) -> None:
        """Count what cannot be said: a body that reports nonsense must not end its agent."""
        self.unsaid += 1
        logger.error("robot %d cannot say its %s: %s", self.robot_id, topic.value, error)
