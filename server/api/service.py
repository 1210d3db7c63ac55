"""What REST, the stream and the console do with missions. One live mission per server."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from http import HTTPStatus
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import structlog

from server.api import revival
from server.api.catalogue import Catalogue, Definition
from server.api.chronicle import Chronicle
from server.api.errors import ServiceError
from server.api.hindsight import Hindsight
from server.api.models import CommentModel, LlmProfile, MissionInfo, MissionRequest, ScenarioInfo
from server.api.processes import MakeHost, Processes, another_flies, conflict, end_processes
from server.api.queueing import LockstepQueue, slots
from server.api.record import MissionRecord
from server.api.recovery import AfterCrash, Interrupted, bring_up, launch
from server.api.shelf import ScenarioShelf
from server.api.watch import Watch, tell_of_journal
from server.encoding import EventKind, MissionState, Severity
from server.journal.journal import Journal, JournalStatus
from server.live.fanout import Messages
from server.live.outbox import Outbox

log = structlog.get_logger(__name__)

MAX_MISSIONS = 100
"""Kept at once; delete old ones to make room."""


class MissionService:
    """Owner of the missions. Use it as a context: on leaving, every process is ended.

    The journal is open as long as the service is, and is not the service's to close.
    """

    def __init__(
        self,
        catalogue: Catalogue,
        make_planner: MakeHost,
        make_world: MakeHost,
        journal: Journal,
        after_crash: AfterCrash = AfterCrash.HOLD,
    ) -> None:
        self._catalogue = catalogue
        self._journal = journal
        self._after_crash = after_crash
        self.chronicle = Chronicle(journal)
        self.shelf = ScenarioShelf(catalogue, journal)
        self._processes = Processes(make_planner, make_world)
        self._missions: dict[str, MissionRecord] = {}
        self.hindsight = Hindsight(self._record, self.chronicle)
        self.watch = Watch(self._record)
        self._count = 0
        self._queue = LockstepQueue(self._processes, slots())
        self._starting = asyncio.Lock()
        self._reviving: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> Self:
        """Bring up what was broken off. Raises JournalUnavailable."""
        self._journal.watch(lambda status: tell_of_journal(self._missions.values(), status))
        await asyncio.to_thread(self._catalogue.scenarios)  # it reads them when first asked
        await self.shelf.load()
        self._count, found = await revival.revived(self._journal, self._catalogue.bus)
        for known in found:
            record = MissionRecord.revive(known, self.chronicle)
            self._missions[record.id] = record
            if known.broken_off and record.virtual:
                record.change_state(MissionState.FAILED, "the server was interrupted")
            elif known.broken_off:
                record.change_state(MissionState.HELD, "the server was interrupted")
                task = asyncio.create_task(self._bring_up(record), name=f"revive {record.id}")
                self._reviving.add(task)
                task.add_done_callback(self._reviving.discard)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self._queue.close()
        for task in self._reviving:
            task.cancel()
        await asyncio.gather(*self._reviving, return_exceptions=True)
        for record in self.records():
            if record.live:
                await self._processes.retire(record)
        await asyncio.gather(*(end_processes(record) for record in self._missions.values()))
        for record in self._missions.values():
            record.fanout.close("the server is shutting down")

    # ------------------------------------------------------------------ to see

    def scenarios(self) -> tuple[ScenarioInfo, ...]:
        """Return the scenarios known by name."""
        return self._catalogue.scenarios() + self.shelf.infos()

    def profiles(self) -> tuple[LlmProfile, ...]:
        """Return the configured model profiles."""
        return self._catalogue.profiles()

    def missions(self) -> tuple[MissionInfo, ...]:
        """Return all missions, oldest first."""
        return tuple(record.info() for record in self._missions.values())

    def records(self) -> list[MissionRecord]:
        """Return what is kept of every mission, for metrics."""
        return list(self._missions.values())

    def mission(self, mission_id: str) -> MissionInfo:
        """Return one mission. Raises ServiceError 404."""
        return self._record(mission_id).info()

    def live_mission(self) -> MissionInfo | None:
        """Return the mission that flies vehicles now, if any: no replay, none in lockstep."""
        flying = (r for r in self._missions.values() if r.live and r.real)
        return next((record.info() for record in flying), None)

    def readers(self, mission_id: str) -> int:
        """Return how many subscriptions a mission has. Raises ServiceError 404."""
        return self._record(mission_id).fanout.readers

    def snapshot(self, mission_id: str) -> dict[str, Any] | None:
        """Return the newest snapshot message, None before the first. Raises ServiceError 404."""
        return self._record(mission_id).snapshot

    @property
    def journal(self) -> JournalStatus:
        """How the journal does."""
        return self._journal.status

    async def events(
        self, mission_id: str, after_seq: int = 0, limit: int = 100
    ) -> list[dict[str, Any]]:
        """Return events after a sequence number, oldest first. Raises ServiceError 404, 503."""
        return await self._record(mission_id).events(after_seq, limit)

    async def history(self, mission_id: str, after: int, limit: int) -> list[dict[str, Any]]:
        """Return one sample per second, oldest first. Raises ServiceError 404, 503."""
        return await self.chronicle.samples(self._record(mission_id).id, after, limit)

    def recent_events(self, mission_id: str, limit: int) -> list[dict[str, Any]]:
        """Return the newest events, oldest first. Raises ServiceError 404."""
        return self._record(mission_id).recent_events(limit)

    def comments(self, mission_id: str) -> tuple[CommentModel, ...]:
        """Return a mission's comments, oldest first. Raises ServiceError 404."""
        return tuple(self._record(mission_id).comments.values())

    def comment_by_id(self, mission_id: str, comment_id: str) -> CommentModel:
        """Return one comment. Raises ServiceError 404."""
        comment = self._record(mission_id).comments.get(comment_id)
        if comment is None:
            raise ServiceError(
                "comment_unknown",
                f"There is no comment {comment_id} in mission {mission_id}.",
                HTTPStatus.NOT_FOUND,
            )
        return comment

    def decisions(self, mission_id: str, after: int, limit: int) -> list[dict[str, Any]]:
        """Return decision cards after a number, oldest first. Raises ServiceError 404."""
        return self._record(mission_id).decision_page(after, limit)

    def newest_decisions(self, mission_id: str, limit: int) -> list[dict[str, Any]]:
        """Return the newest decision cards, newest first. Raises ServiceError 404."""
        return list(islice(reversed(self._record(mission_id).decisions.values()), limit))

    def decision(self, mission_id: str, decision_id: str) -> dict[str, Any]:
        """Return one card with the prompts and raw answers behind it. Raises ServiceError 404."""
        return self._record(mission_id).decision(decision_id)

    async def result(self, mission_id: str) -> dict[str, Any]:
        """Return the figures so far, or the final ones. Raises ServiceError 404, 409, 503."""
        record = self._record(mission_id)
        if record.live:
            record.result = await self._processes.ask(record, "result")
        if record.result is None:
            raise ServiceError(
                "no_result",
                f"Mission {mission_id} is {record.state} and has no figures.",
                HTTPStatus.CONFLICT,
            )
        return record.result

    @asynccontextmanager
    async def subscribe(self, mission_id: str) -> AsyncIterator[AsyncIterator[dict[str, Any]]]:
        """Open a stream of snapshot and event messages. Raises ServiceError 404.

        A slow reader gets the newest snapshot and all events; one that is too far behind is
        ended.
        """
        with self.frames(mission_id) as outbox:
            yield Messages(outbox)

    @contextmanager
    def frames(self, mission_id: str) -> Iterator[Outbox]:
        """Open the same stream with the encoded text of each message."""
        with self._record(mission_id).fanout.subscribe() as outbox:
            yield outbox

    def recording(self, mission_id: str) -> Path:
        """Return the file that a mission is recorded into. Raises ServiceError 404, 409."""
        path = self._record(mission_id).recording
        if path is None:
            raise ServiceError(
                "not_recorded",
                f"Mission {mission_id} is not recorded; FALCONER_RECORDINGS names a folder for it.",
                HTTPStatus.CONFLICT,
            )
        return path

    def checked_scenario(self, scenario: str | dict[str, Any]) -> str | dict[str, Any]:
        """Return a scenario that missions can be made from. It takes its time: ask in a thread.

        Raises ServiceError 422.
        """
        request = self.shelf.resolved(MissionRequest(scenario=scenario, llm="none"))
        self._catalogue.define(request)
        return request.scenario

    def model_address(self, profile: str) -> str:
        """Return what a model profile stands for. Raises ServiceError 422."""
        return self._catalogue.model_address(profile)

    # ------------------------------------------------------------------ to change

    async def create(self, request: MissionRequest, author: str) -> MissionInfo:
        """Check a request and keep it as a mission. Raises ServiceError 409, 422, 503."""
        resolved = self.shelf.resolved(request)
        return await self.add(await asyncio.to_thread(self._catalogue.define, resolved), author)

    async def add(self, definition: Definition, author: str) -> MissionInfo:
        """Keep a definition as a mission that has not started. Raises ServiceError 409, 503."""
        if len(self._missions) >= MAX_MISSIONS:
            raise ServiceError(
                "too_many_missions",
                f"{MAX_MISSIONS} missions are kept already; delete one first.",
                HTTPStatus.CONFLICT,
            )
        self._count += 1
        record = MissionRecord(f"m{self._count}", definition, self.chronicle)
        await self.chronicle.made(record.id, definition, author)
        self._missions[record.id] = record
        return record.info()

    async def start(self, mission_id: str, author: str) -> MissionInfo:
        """Start a mission, a failed one held where it was; a live one stays as it is.

        Raises ServiceError 404, 409 (another is live, or it has ended), 503.
        """
        record = self._record(mission_id)
        async with self._starting, record.change:
            if record.live:
                return record.info()
            if record.state is MissionState.ENDED:
                raise conflict(record, "cannot be started again; create a new mission")
            if record.virtual:
                if record.state is not MissionState.QUEUED:
                    self._queue.enter(record, author)
                return record.info()
            other = self.live_mission() if record.real else None
            if other is not None:
                raise another_flies(other.id)
            await launch(record, self._processes)
            self.hindsight.keep_past(record, self._missions.values())
            await self.chronicle.final(record.id, record.state, "started", author, record.time_s)
        log.info("mission started", mission=record.id, author=author)
        return record.info()

    async def hold(self, mission_id: str, author: str) -> MissionInfo:
        """Stop all vehicles where they are. Never waits for another request."""
        return await self._steer(mission_id, "hold", author)

    async def pause(self, mission_id: str, author: str) -> MissionInfo:
        """Stop mission time: nothing is planned, models are not asked, vehicles hold."""
        return await self._steer(mission_id, "pause", author)

    async def resume(self, mission_id: str, author: str) -> MissionInfo:
        """Go on after hold or pause."""
        return await self._steer(mission_id, "resume", author)

    async def stop(self, mission_id: str, author: str) -> MissionInfo:
        """End a mission for good and keep its figures; once ended nothing more happens.

        Raises ServiceError 404.
        """
        record = self._record(mission_id)
        async with record.change:
            if record.live:
                try:
                    answer = await self._processes.ask(record, "stop", {"author": author})
                    record.result = answer["result"]
                except ServiceError as error:
                    log.warning("mission did not stop by itself", mission=record.id, why=str(error))
            ended_now = record.state is not MissionState.ENDED
            if ended_now:
                record.change_state(MissionState.ENDED, f"stopped by {author}", author)
            await end_processes(record)
            if ended_now:
                record.report(EventKind.ENDED, Severity.INFO, f"Mission stopped by {author}.")
                await self._settle(record, record.state.value, author)
        return record.info()

    async def seek(self, mission_id: str, time_s: float, speed: float | None) -> MissionInfo:
        """Go to an instant of a replay. Raises ServiceError 404, 409, 503."""
        record = self._record(mission_id)
        params = {"time_s": time_s} if speed is None else {"time_s": time_s, "speed": speed}
        await self._processes.ask(record, "seek", params)
        return record.info()

    async def delete(self, mission_id: str, author: str) -> None:
        """Forget a mission that does not fly. Raises ServiceError 404, 409."""
        record = self._record(mission_id)
        async with record.change:
            if record.live or record.state is MissionState.QUEUED:
                raise conflict(record, "must be stopped before it can be deleted")
            await end_processes(record)
            record.fanout.close()
            if self._missions.pop(mission_id, None) is not None:
                await self._settle(record, revival.DELETED, author)

    async def comment(self, mission_id: str, text: str, author: str) -> CommentModel:
        """Give a comment to the models. Raises ServiceError 404, 409, 429, 503."""
        record = self._record(mission_id)
        if not record.live:
            raise conflict(record, "takes no comments")
        said = {"id": record.next_comment_id(), "text": text, "author": author}
        await self.chronicle.comment(record.id, said["id"], text, author, record.time_s)
        try:
            answer = await self._processes.ask(record, "comment", said)
        except ServiceError as error:
            self.chronicle.comment_refused(record.id, said["id"], author, error.code)
            raise
        comment = CommentModel.model_validate(answer)
        if comment.id not in record.comments:  # else a later picture has told more of it already
            record.keep_comment(comment)
        return comment

    async def direct(
        self, mission_id: str, what: str, asked: dict[str, Any], author: str
    ) -> dict[str, Any]:
        """Change directives in person (`server.live.overrides`).

        Raises ServiceError 404, 409, 422 (verification), 503.
        """
        record = self._record(mission_id)
        if not record.live:
            raise conflict(record, "cannot be directed")
        said = {"what": what, "asked": asked, "author": author}
        answer = await self._processes.ask(record, "override", said)
        await self._processes.save(record)
        await self.chronicle.override(record.id, what, asked, author, record.time_s)
        return answer

    # ------------------------------------------------------------------ inside

    def _record(self, mission_id: str) -> MissionRecord:
        record = self._missions.get(mission_id)
        if record is None:
            raise ServiceError(
                "mission_unknown", f"There is no mission {mission_id}.", HTTPStatus.NOT_FOUND
            )
        return record

    async def _steer(self, mission_id: str, op: str, author: str) -> MissionInfo:
        record = self._record(mission_id)
        if not record.live:
            raise conflict(record, f"cannot {op}")
        if record.host is None and op == "hold":
            return record.info()  # it is being brought up, and comes up held
        answer = await self._processes.ask(record, op, {"author": author})
        if record.live:  # it may have ended while we asked
            state = MissionState(answer["state"])
            record.change_state(state)
            self.chronicle.state(record.id, state.value, op, author, record.time_s)
        return record.info()

    async def _settle(self, record: MissionRecord, state: str, author: str) -> None:
        """Let a state outlast a crash from now on, where there is a journal."""
        await self.chronicle.final(record.id, state, record.reason, author, record.time_s)

    async def _bring_up(self, record: MissionRecord) -> None:
        """Fly a mission on that was broken off. It is held meanwhile, and after."""
        async with self._starting, record.change:
            flies = await bring_up(record, self._processes, Interrupted.SERVER)
        simulated = record.definition.world is not None
        if flies and simulated and self._after_crash is AfterCrash.RESUME_SIMULATED:
            try:
                await self.resume(record.id, "auto_resume")
            except ServiceError as error:
                log.warning("mission stays held", mission=record.id, why=str(error))
