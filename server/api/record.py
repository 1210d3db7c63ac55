"""One mission as the web side keeps it: its state, what it said, and who listens."""

import asyncio
import json
from collections import deque
from datetime import UTC, datetime
from http import HTTPStatus
from itertools import islice
from pathlib import Path
from typing import Any

import structlog

from server.api.alarm_models import Alarm
from server.api.alarms import AlarmBook
from server.api.catalogue import Definition
from server.api.chronicle import Chronicle
from server.api.errors import ServiceError
from server.api.models import Clock, CommentModel, MissionInfo
from server.api.past import Past
from server.api.revival import Remains, Revived, remains_of
from server.course import SAMPLE_S, Course, sample_of
from server.encoding import EventKind, MissionState, Severity, event_message, number
from server.live.channel import frame
from server.live.fanout import Fanout
from server.live.host import Host
from server.live.outbox import CHECKPOINT, VITALS, Frame
from solver.observations import Comment

log = structlog.get_logger(__name__)

EVENTS_KEPT = 5000
COMMENTS_KEPT = 1000
DECISIONS_KEPT = 1000
EXCHANGES_KEPT = 100

LIVE = frozenset({MissionState.RUNNING, MissionState.HELD, MissionState.PAUSED})


class MissionRecord:
    """Owner of what is known of one mission outside its process."""

    def __init__(self, mission_id: str, definition: Definition, chronicle: Chronicle) -> None:
        self.id = mission_id
        self._chronicle = chronicle
        self.definition = definition
        self.state = MissionState.CREATED
        self.reason = ""
        self.created_at = datetime.now(UTC)
        self.started_at: datetime | None = None
        self.host: Host | None = None
        self.endpoint: str | None = None
        """Where its bus listens; the same again when its planner is started again."""

        self.recording: Path | None = None
        """Where it is recorded, or what it replays."""

        self.tasks: set[asyncio.Task[None]] = set()
        """Those that run its processes."""

        self.result: dict[str, Any] | None = None
        self.fanout = Fanout()
        self.comments: dict[str, CommentModel] = {}
        self.decisions: dict[str, dict[str, Any]] = {}
        """Cards by id, oldest first."""

        self.exchanges: dict[str, list[dict[str, Any]]] = {}
        """Prompts and raw answers of the newest cards."""

        self.past = Past()
        """Its last pictures, while it flies in real time and until another one does."""

        self.course: Course | None = None if self.replays else Course()
        """How it went; None until it has been read from the journal or a recording."""

        self.reading = asyncio.Lock()
        """Held while its course is read."""

        self.alarms = AlarmBook()

        self.change = asyncio.Lock()
        """Held while its processes are started or ended. Hold never takes it."""

        self.vitals: dict[str, Any] = {}
        """How its process does (server.live.vitals); empty before it told."""

        self._remains: Remains | None = None
        """What the journal knew of it when the server started."""

        self._made = definition
        self._kept: dict[str, Any] | None = None
        """The newest checkpoint of a process that this server ran."""

        self._events: deque[dict[str, Any]] = deque(maxlen=EVENTS_KEPT)
        self._seq = 0
        self._samples = 0
        self._sampled_s = -SAMPLE_S
        self._comment_count = len(definition.planner.get("comments", ()))

    @classmethod
    def revive(cls, revived: Revived, chronicle: Chronicle) -> "MissionRecord":
        """Return a record of what the journal knows; one that was live is held."""
        record = cls(revived.id, revived.definition, chronicle)
        record._remains = revived.remains
        record.state, record.reason = revived.state, revived.reason
        record.created_at = revived.created_at
        record.result = revived.result
        record.course = None
        recorded = revived.definition.planner.get("record")
        if recorded is not None and Path(recorded).exists():
            record.recording = Path(recorded)
        record._seq, record._samples = revived.events, revived.samples
        record.decisions = {card["id"]: card for card in revived.decisions}
        record.alarms = revived.alarms
        for comment in revived.comments:
            record.keep_comment(comment)
            number = comment.id.removeprefix("c")
            if number.isdecimal():
                record._comment_count = max(record._comment_count, int(number))
        return record

    @property
    def live(self) -> bool:
        """Whether its process flies vehicles."""
        return self.state in LIVE

    @property
    def virtual(self) -> bool:
        """Whether it flies in virtual time: nobody's vehicles, and several at once."""
        return self.definition.clock is Clock.LOCKSTEP

    @property
    def real(self) -> bool:
        """Whether it flies in real time: there is one such mission at a time."""
        return self.definition.clock is Clock.REALTIME

    @property
    def replays(self) -> bool:
        """Whether it only shows a recording: nothing flies."""
        return self.definition.clock is Clock.REPLAY

    @property
    def snapshot(self) -> dict[str, Any] | None:
        """The newest snapshot message."""
        return None if self.fanout.last is None else self.fanout.last.data

    @property
    def has_flown(self) -> bool:
        """Whether a second of it or more is known, from its process or from the journal."""
        return self.snapshot is not None or self._samples > 0

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
            gate=self.definition.gate,
            seed=self.definition.seed,
            created_at=self.created_at,
            started_at=self.started_at,
            time_s=number(self.time_s, 3),
            reason=self.reason,
        )

    @property
    def newest_event(self) -> int:
        """The number of the newest event, 0 before the first."""
        return self._seq

    def next_comment_id(self) -> str:
        """Return the id of the next comment; those said by themselves come first."""
        self._comment_count += 1
        return f"c{self._comment_count}"

    def receive(self, said: Frame) -> None:
        """Take a message from the mission's process, and pass it on."""
        if self.state is MissionState.ENDED:
            return
        if said.kind == CHECKPOINT:
            self.keep_checkpoint(said.text)
            return
        if said.kind == VITALS:
            self.vitals = said.data
            return
        if said.is_snapshot:
            self._take_state(MissionState(said.data["state"]))
            self._sample(said.data)
            if self.real:
                self.past.take(said)
            self.alarms.look(said.data)
            for comment in said.data["comments"]:
                self.keep_comment(CommentModel.model_validate(comment))
            self.fanout.publish(said)
            return
        if said.data.get("type") == "exchange":
            self._keep_exchange(said.data)
            return
        if said.data.get("kind") == EventKind.DECISION:
            self._keep_decision(said.data["data"]["decision"], said.data["text"])
        if said.data.get("kind") == EventKind.ENDED:
            self.result = said.data["data"].get("result")
            self.change_state(MissionState.ENDED, said.data["text"])
        self._publish_event(said.data)

    def keep_checkpoint(self, text: str) -> None:
        """Let the journal keep what the mission needs to go on."""
        self._kept = {"text": text, "at": datetime.now(UTC).isoformat()}
        self._chronicle.journal.keep(self.id, text)

    @property
    def remains(self) -> Remains | None:
        """Where it goes on when its processes are started again, None before its first flight."""
        if self._kept is None:
            return self._remains
        said = (
            Comment(comment.id, comment.text, comment.time_s, 0.0, comment.author)
            for comment in self.comments.values()
        )
        kept = json.loads(self._kept["text"]) | {"at": self._kept["at"]}
        return remains_of(kept, self._made, said)

    def report(
        self,
        kind: EventKind,
        severity: Severity,
        text: str,
        component: str | None = None,
    ) -> None:
        """Tell readers something that the process itself cannot tell."""
        data = {} if component is None else {"component": component}
        self._tell(kind, severity, text, data)

    def acknowledge(self, alarm: Alarm, author: str) -> None:
        """Tell that somebody has taken note of an alarm."""
        text = f"{author.capitalize()} acknowledged: {alarm.title}."
        data = {"acknowledged": alarm.id, "by": author}
        self._tell(EventKind.ALARM, Severity.INFO, text, data, author)

    def _tell(
        self,
        kind: EventKind,
        severity: Severity,
        text: str,
        data: dict[str, Any],
        author: str = "",
    ) -> None:
        now_s = self._goes_on_s() if self.time_s is None else self.time_s
        self._publish_event(event_message(self.id, 0, now_s, kind, severity, text, data), author)

    def _goes_on_s(self) -> float:
        """Return the mission time at which it goes on after a crash, 0 where it begins."""
        start = None if self._remains is None else self._remains.start
        return 0.0 if start is None else start.time_s

    def change_state(self, state: MissionState, reason: str = "", author: str = "") -> None:
        """Take a new state; readers see it on the last snapshot."""
        self.reason = reason
        self._take_state(state, author)
        last = self.snapshot
        if last is not None and last["state"] != state:
            self.fanout.publish(frame(last | {"state": state.value}))

    def keep_comment(self, comment: CommentModel) -> None:
        """Remember the newest receipt of a comment; the oldest comments are forgotten."""
        self.comments[comment.id] = comment
        while len(self.comments) > COMMENTS_KEPT:
            del self.comments[next(iter(self.comments))]

    def decision_page(self, after: int, limit: int) -> list[dict[str, Any]]:
        """Return the oldest `limit` decision cards after a number, oldest first."""
        found = (card for card in self.decisions.values() if int(card["id"][1:]) > after)
        return list(islice(found, limit))

    def decision(self, decision_id: str) -> dict[str, Any]:
        """Return a card with the prompts and raw answers behind it. Raises ServiceError 404."""
        card = self.decisions.get(decision_id)
        if card is None:
            raise ServiceError(
                "decision_unknown",
                f"There is no decision {decision_id} in mission {self.id}.",
                HTTPStatus.NOT_FOUND,
            )
        return card | {"exchange": self.exchanges.get(decision_id)}

    def _keep_decision(self, card: dict[str, Any], words: str) -> None:
        """Remember the newest state of a card; the oldest cards are forgotten.

        A card is told again when its effect is known: `words` say what is new.
        """
        log.info(
            "decision",
            mission=self.id,
            decision=card["id"],
            status=card.get("status"),
            source=card.get("source"),
            said=words,
        )
        self.decisions[card["id"]] = card
        while len(self.decisions) > DECISIONS_KEPT:
            del self.decisions[next(iter(self.decisions))]

    def _keep_exchange(self, exchange: dict[str, Any]) -> None:
        self.exchanges[exchange["id"]] = exchange["attempts"]
        while len(self.exchanges) > EXCHANGES_KEPT:
            del self.exchanges[next(iter(self.exchanges))]

    async def events(self, after_seq: int, limit: int) -> list[dict[str, Any]]:
        """Return the oldest `limit` events after a sequence number, oldest first.

        Those that are no longer in memory come from the journal: ServiceError 503.
        """
        first = self._events[0]["seq"] if self._events else self._seq + 1
        if after_seq + 1 < first:
            older = await self._chronicle.events(self.id, after_seq, limit)
            if older:
                return older
        return self._remembered(after_seq, limit)

    def _remembered(self, after_seq: int, limit: int) -> list[dict[str, Any]]:
        first = self._events[0]["seq"] if self._events else 1
        start = max(0, after_seq + 1 - first)
        return [self._events[i] for i in range(start, min(start + limit, len(self._events)))]

    def recent_events(self, limit: int) -> list[dict[str, Any]]:
        """Return the newest `limit` events, oldest first."""
        return self._remembered(max(0, self._seq - limit), limit)

    def _take_state(self, state: MissionState, author: str = "") -> None:
        if state is not self.state:
            self.state = state
            self._chronicle.state(self.id, state.value, self.reason, author, self.time_s)
            if state is MissionState.ENDED:
                self.alarms.close()

    def _sample(self, snapshot: dict[str, Any]) -> None:
        """Write what `history` shows, once a second of mission time."""
        time_s = snapshot["time_s"]
        if time_s is None or time_s < self._sampled_s + SAMPLE_S:
            return
        self._sampled_s = time_s
        self._samples += 1
        figures = sample_of(snapshot)
        if self.course is not None and not self.replays:
            self.course.add(figures)
        self._chronicle.sample(self.id, self._samples, figures)

    def _publish_event(self, event: dict[str, Any], author: str = "") -> None:
        """Number an event: one sequence per mission, whatever process it came from."""
        self._seq += 1
        numbered = event | {"seq": self._seq}
        self._events.append(numbered)
        self._chronicle.event(self.id, numbered, author)
        self.alarms.take(numbered)
        if self.course is not None and not self.replays:
            self.course.note(numbered)
        self.fanout.publish(frame(numbered))
