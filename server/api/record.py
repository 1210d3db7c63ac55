"""One mission as the web side keeps it: its state, what it said, and who listens."""

import asyncio
from collections import deque
from datetime import UTC, datetime
from typing import Any

from server.api.catalogue import Definition
from server.api.models import CommentModel, MissionInfo
from server.encoding import EventKind, MissionState, Severity, event_message, number
from server.live.channel import frame
from server.live.fanout import Fanout
from server.live.host import Host
from server.live.outbox import Frame

EVENTS_KEPT = 5000
COMMENTS_KEPT = 1000

LIVE = frozenset({MissionState.RUNNING, MissionState.HELD, MissionState.PAUSED})


class MissionRecord:
    """Owner of what is known of one mission outside its process."""

    def __init__(self, mission_id: str, definition: Definition) -> None:
        self.id = mission_id
        self.definition = definition
        self.state = MissionState.CREATED
        self.reason = ""
        self.created_at = datetime.now(UTC)
        self.started_at: datetime | None = None
        self.host: Host | None = None
        self.endpoint: str | None = None
        """Where its bus listens; the same again when its planner is started again."""

        self.tasks: set[asyncio.Task[None]] = set()
        """Those that run its processes."""

        self.result: dict[str, Any] | None = None
        self.fanout = Fanout()
        self.comments: dict[str, CommentModel] = {}
        self.change = asyncio.Lock()
        """Held while its processes are started or ended. Hold never takes it."""

        self._events: deque[dict[str, Any]] = deque(maxlen=EVENTS_KEPT)
        self._seq = 0

    @property
    def live(self) -> bool:
        """Whether its process flies vehicles."""
        return self.state in LIVE

    @property
    def snapshot(self) -> dict[str, Any] | None:
        """The newest snapshot message."""
        return None if self.fanout.last is None else self.fanout.last.data

    @property
    def time_s(self) -> float | None:
        """Mission time of the newest snapshot."""
        return None if self.snapshot is None else self.snapshot["time_s"]

    def info(self) -> MissionInfo:
        """Return the mission as told to clients."""
        return MissionInfo(
            id=self.id,
            scenario=self.definition.scenario,
            state=self.state,
            clock=self.definition.clock,
            llm=self.definition.llm,
            seed=self.definition.seed,
            created_at=self.created_at,
            started_at=self.started_at,
            time_s=number(self.time_s, 3),
            reason=self.reason,
        )

    def receive(self, said: Frame) -> None:
        """Take a message from the mission's process, and pass it on."""
        if self.state is MissionState.ENDED:
            return
        if said.is_snapshot:
            self.state = MissionState(said.data["state"])
            for comment in said.data["comments"]:
                self.keep_comment(CommentModel.model_validate(comment))
            self.fanout.publish(said)
            return
        if said.data.get("kind") == EventKind.ENDED:
            self.result = said.data["data"].get("result")
            self.change_state(MissionState.ENDED, said.data["text"])
        self._publish_event(said.data)

    def report(self, kind: EventKind, severity: Severity, text: str) -> None:
        """Tell readers something that the process itself cannot tell."""
        self._publish_event(event_message(self.id, 0, self.time_s or 0.0, kind, severity, text))

    def change_state(self, state: MissionState, reason: str = "") -> None:
        """Take a new state; readers see it on the last snapshot."""
        self.state, self.reason = state, reason
        last = self.snapshot
        if last is not None and last["state"] != state:
            self.fanout.publish(frame(last | {"state": state.value}))

    def keep_comment(self, comment: CommentModel) -> None:
        """Remember the newest receipt of a comment; the oldest comments are forgotten."""
        self.comments[comment.id] = comment
        while len(self.comments) > COMMENTS_KEPT:
            del self.comments[next(iter(self.comments))]

    def events(self, after_seq: int, limit: int) -> list[dict[str, Any]]:
        """Return the oldest `limit` events after a sequence number, oldest first."""
        first = self._events[0]["seq"] if self._events else 1
        start = max(0, after_seq + 1 - first)
        return [self._events[i] for i in range(start, min(start + limit, len(self._events)))]

    def recent_events(self, limit: int) -> list[dict[str, Any]]:
        """Return the newest `limit` events, oldest first."""
        return self.events(max(0, self._seq - limit), limit)

    def _publish_event(self, event: dict[str, Any]) -> None:
        """Number an event: one sequence per mission, whatever process it came from."""
        self._seq += 1
        numbered = event | {"seq": self._seq}
        self._events.append(numbered)
        self.fanout.publish(frame(numbered))
