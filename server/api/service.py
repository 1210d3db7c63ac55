"""What REST, the stream and the console do with missions. One live mission per server."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from datetime import UTC, datetime
from http import HTTPStatus
from types import TracebackType
from typing import Any, Self

import structlog

from server.api.catalogue import Catalogue, Definition
from server.api.errors import ServiceError
from server.api.models import CommentModel, LlmProfile, MissionInfo, MissionRequest, ScenarioInfo
from server.api.record import MissionRecord
from server.encoding import EventKind, MissionState, Severity
from server.live.channel import ChannelError, RequestRefused
from server.live.fanout import Messages
from server.live.host import START_S, Host
from server.live.outbox import Frame, Outbox

log = structlog.get_logger(__name__)

MAX_MISSIONS = 100
"""Kept at once; delete old ones to make room."""

REQUEST_S = 3.0
"""A mission that does not answer within this time is told of as unavailable."""

PLANNER = "planner"
WORLD = "simulated world"

MakeHost = Callable[[Definition], Host]

_REFUSALS = {
    "too_many_comments": HTTPStatus.TOO_MANY_REQUESTS,
    "busy": HTTPStatus.TOO_MANY_REQUESTS,
}


class MissionService:
    """Owner of the missions. Use it as a context: on leaving, every process is ended."""

    def __init__(self, catalogue: Catalogue, make_planner: MakeHost, make_world: MakeHost) -> None:
        self._catalogue = catalogue
        self._make_planner = make_planner
        self._make_world = make_world
        self._missions: dict[str, MissionRecord] = {}
        self._count = 0
        self._starting = asyncio.Lock()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await asyncio.gather(*(_end_processes(record) for record in self._missions.values()))
        for record in self._missions.values():
            record.fanout.close("the server is shutting down")

    # ------------------------------------------------------------------ to see

    def scenarios(self) -> tuple[ScenarioInfo, ...]:
        """Return the scenarios known by name."""
        return self._catalogue.scenarios()

    def profiles(self) -> tuple[LlmProfile, ...]:
        """Return the configured model profiles."""
        return self._catalogue.profiles()

    def missions(self) -> tuple[MissionInfo, ...]:
        """Return all missions, oldest first."""
        return tuple(record.info() for record in self._missions.values())

    def mission(self, mission_id: str) -> MissionInfo:
        """Return one mission. Raises ServiceError 404."""
        return self._record(mission_id).info()

    def live_mission(self) -> MissionInfo | None:
        """Return the mission that flies now, if any."""
        return next((r.info() for r in self._missions.values() if r.live), None)

    def readers(self, mission_id: str) -> int:
        """Return how many subscriptions a mission has. Raises ServiceError 404."""
        return self._record(mission_id).fanout.readers

    def snapshot(self, mission_id: str) -> dict[str, Any] | None:
        """Return the newest snapshot message, None before the first. Raises ServiceError 404."""
        return self._record(mission_id).snapshot

    def events(self, mission_id: str, after_seq: int = 0, limit: int = 100) -> list[dict[str, Any]]:
        """Return events after a sequence number, oldest first. Raises ServiceError 404."""
        return self._record(mission_id).events(after_seq, limit)

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

    async def result(self, mission_id: str) -> dict[str, Any]:
        """Return the figures so far, or the final ones. Raises ServiceError 404, 409, 503."""
        record = self._record(mission_id)
        if record.live:
            record.result = await self._ask(record, "result")
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

    # ------------------------------------------------------------------ to change

    async def create(self, request: MissionRequest) -> MissionInfo:
        """Check a request and keep it as a mission. Raises ServiceError 409, 422."""
        return self.add(self._catalogue.define(request))

    def add(self, definition: Definition) -> MissionInfo:
        """Keep a definition as a mission that has not started. Raises ServiceError 409."""
        if len(self._missions) >= MAX_MISSIONS:
            raise ServiceError(
                "too_many_missions",
                f"{MAX_MISSIONS} missions are kept already; delete one first.",
                HTTPStatus.CONFLICT,
            )
        self._count += 1
        record = MissionRecord(f"m{self._count}", definition)
        self._missions[record.id] = record
        return record.info()

    async def start(self, mission_id: str, author: str) -> MissionInfo:
        """Start a mission, or start a failed one again; a live one stays as it is.

        Raises ServiceError 404, 409 (another is live, or it has ended), 503.
        """
        record = self._record(mission_id)
        async with self._starting, record.change:
            if record.live:
                return record.info()
            if record.state is MissionState.ENDED:
                raise _conflict(record, "cannot be started again; create a new mission")
            other = self.live_mission()
            if other is not None:
                raise ServiceError(
                    "mission_live",
                    f"Mission {other.id} is live; one server flies one mission at a time.",
                    HTTPStatus.CONFLICT,
                    {"live_mission": other.id},
                )
            await self._launch(record)
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
                    answer = await self._ask(record, "stop", {"author": author})
                    record.result = answer["result"]
                except ServiceError as error:
                    log.warning("mission did not stop by itself", mission=record.id, why=str(error))
            ended_now = record.state is not MissionState.ENDED
            if ended_now:
                record.change_state(MissionState.ENDED, f"stopped by {author}")
            await _end_processes(record)
            if ended_now:
                record.report(EventKind.ENDED, Severity.INFO, f"Mission stopped by {author}.")
        return record.info()

    async def delete(self, mission_id: str) -> None:
        """Forget a mission that does not fly. Raises ServiceError 404, 409."""
        record = self._record(mission_id)
        async with record.change:
            if record.live:
                raise _conflict(record, "must be stopped before it can be deleted")
            await _end_processes(record)
            record.fanout.close()
            self._missions.pop(mission_id, None)

    async def comment(self, mission_id: str, text: str, author: str) -> CommentModel:
        """Give a comment to the models. Raises ServiceError 404, 409, 429, 503."""
        record = self._record(mission_id)
        if not record.live:
            raise _conflict(record, "takes no comments")
        answer = await self._ask(record, "comment", {"text": text, "author": author})
        comment = CommentModel.model_validate(answer)
        record.keep_comment(comment)
        return comment

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
            raise _conflict(record, f"cannot {op}")
        answer = await self._ask(record, op, {"author": author})
        if record.live:  # it may have ended while we asked
            record.change_state(MissionState(answer["state"]))
        return record.info()

    async def _ask(
        self,
        record: MissionRecord,
        op: str,
        params: Mapping[str, Any] | None = None,
        timeout_s: float = REQUEST_S,
    ) -> dict[str, Any]:
        if record.host is None:
            raise _conflict(record, f"cannot {op}")
        try:
            return await record.host.request(op, params, timeout_s=timeout_s)
        except RequestRefused as refused:
            status = _REFUSALS.get(refused.code, HTTPStatus.CONFLICT)
            raise ServiceError(refused.code, refused.message, status, refused.details) from refused
        except ChannelError as error:
            raise ServiceError(
                "mission_unavailable",
                f"Mission {record.id} does not answer: {error}.",
                HTTPStatus.SERVICE_UNAVAILABLE,
            ) from error

    async def _launch(self, record: MissionRecord) -> None:
        """Start the processes of a mission: planner, world, and then its clock."""
        definition = record.definition
        try:
            planner = self._make_planner(definition)
            self._run(record, planner, PLANNER)
            job = {"mission": record.id, "job": definition.planner, "endpoint": record.endpoint}
            answer = await planner.request("prepare", job, timeout_s=START_S)
            record.endpoint = answer["endpoint"]
            if definition.world is not None and len(record.tasks) == 1:
                world = self._make_world(definition)
                self._run(record, world, WORLD)
                job = {"job": definition.world, "endpoint": record.endpoint}
                await world.request("start", job, timeout_s=START_S)
            await planner.request("start", timeout_s=REQUEST_S)
        except ChannelError as error:
            await _end_processes(record)
            record.change_state(MissionState.FAILED, str(error))
            raise ServiceError(
                "start_failed",
                f"Mission {record.id} could not be started: {error}.",
                HTTPStatus.SERVICE_UNAVAILABLE,
            ) from error
        record.host = planner
        record.started_at = record.started_at or datetime.now(UTC)
        record.change_state(MissionState.RUNNING)

    def _run(self, record: MissionRecord, host: Host, role: str) -> None:
        """Run a host in a task of its own; its unexpected end fails the mission."""

        def receive(said: Frame) -> None:
            record.receive(said)
            if record.state is MissionState.ENDED and not record.change.locked():
                task.cancel()

        async def run() -> None:
            code = await host.run(receive)
            log.info("process ended", mission=record.id, process=role, exit_code=code)

        def ended(task: asyncio.Task[None]) -> None:
            record.tasks.discard(task)
            if record.host is host:
                record.host = None
            if record.state is MissionState.ENDED:
                for other in record.tasks:
                    if not other.cancelling():
                        other.cancel()
            error = None if task.cancelled() else task.exception()
            if error is not None:
                log.error("host failed", mission=record.id, process=role, exc_info=error)
            if task.cancelled() or not record.live:
                return
            if role == PLANNER:
                record.change_state(MissionState.FAILED, "the planner process has ended")
            record.report(
                EventKind.ALARM,
                Severity.ALARM,
                f"The {role} process has ended unexpectedly. Vehicles hold by themselves.",
            )

        task = asyncio.create_task(run(), name=f"{record.id} {role}")
        record.tasks.add(task)
        task.add_done_callback(ended)


def _conflict(record: MissionRecord, what: str) -> ServiceError:
    return ServiceError(
        "wrong_state",
        f"Mission {record.id} is {record.state} and {what}.",
        HTTPStatus.CONFLICT,
        {"state": record.state.value},
    )


async def _end_processes(record: MissionRecord) -> None:
    """End a mission's processes and wait until they are gone."""
    record.host = None
    tasks = tuple(record.tasks)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
