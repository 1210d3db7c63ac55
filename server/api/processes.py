"""The processes of missions: planner and simulated world, started, asked and ended."""

import asyncio
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from http import HTTPStatus
from pathlib import Path
from typing import Any

import structlog

from server.api.catalogue import Definition
from server.api.errors import ServiceError
from server.api.record import MissionRecord
from server.encoding import EventKind, MissionState, Severity
from server.errors import BadInput
from server.live.channel import ChannelError, RequestRefused, encode
from server.live.host import START_S, Host
from server.live.outbox import Frame

log = structlog.get_logger(__name__)

REQUEST_S = 3.0
"""A mission that does not answer within this time is told of as unavailable."""

PLANNER = "planner"
WORLD = "world"
"""Which process it is, as events and logs name it."""

_WORDS = {PLANNER: "planner", WORLD: "simulated world"}

MakeHost = Callable[[Definition], Host]

_REFUSALS = {
    "too_many_comments": HTTPStatus.TOO_MANY_REQUESTS,
    "busy": HTTPStatus.TOO_MANY_REQUESTS,
    "override_refused": HTTPStatus.UNPROCESSABLE_ENTITY,
    "pin_unknown": HTTPStatus.NOT_FOUND,
    "zone_unknown": HTTPStatus.NOT_FOUND,
    "decision_unknown": HTTPStatus.NOT_FOUND,
    "internal_error": HTTPStatus.INTERNAL_SERVER_ERROR,
}


class Processes:
    """Starts a mission's processes and talks to its planner."""

    def __init__(self, make_planner: MakeHost, make_world: MakeHost) -> None:
        self._make_planner = make_planner
        self._make_world = make_world

    async def ask(
        self,
        record: MissionRecord,
        op: str,
        params: Mapping[str, Any] | None = None,
        timeout_s: float = REQUEST_S,
    ) -> dict[str, Any]:
        """Ask a mission's planner. Raises ServiceError 409, 429, 503."""
        if record.host is None:
            raise conflict(record, f"cannot {op}")
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

    async def save(self, record: MissionRecord) -> None:
        """Take a checkpoint now, so that the next commit holds what was just changed."""
        try:
            record.keep_checkpoint(encode(await self.ask(record, "checkpoint")))
        except ServiceError as error:
            log.warning("no checkpoint", mission=record.id, why=str(error))

    async def retire(self, record: MissionRecord) -> None:
        """End a live mission with its server, and keep its figures.

        An orderly end is no crash: nothing goes on after it. The process is ended elsewhere.
        """
        try:
            if record.host is not None:
                record.result = await self.ask(record, "result")
        except ServiceError as error:
            log.warning("no figures", mission=record.id, why=str(error))
        record.change_state(MissionState.ENDED, "the server was shut down")

    async def launch(self, record: MissionRecord) -> None:
        """Start the processes of a mission: planner, world, and then its clock.

        The caller holds `record.change`. Raises ServiceError 503.
        """
        definition = record.definition
        try:
            # Whoever shows a recording reads through all of it first.
            planner = await asyncio.to_thread(self._make_planner, definition)
            self._run(record, planner, PLANNER)
            world = None
            if definition.world is not None and len(record.tasks) == 1:
                # Started beside the planner: both take about a second before they can answer.
                world = self._make_world(definition)
                self._run(record, world, WORLD)
            job = {
                "mission": record.id,
                "job": definition.planner,
                "endpoint": record.endpoint,
                "decisions": record.newest_event,
            }
            answer = await planner.request("prepare", job, timeout_s=START_S)
            record.endpoint = answer["endpoint"]
            if answer.get("recording") is not None:
                record.recording = Path(answer["recording"])
            if world is not None:
                job = {"job": definition.world, "endpoint": record.endpoint}
                await world.request("start", job, timeout_s=START_S)
            await planner.request("start", timeout_s=REQUEST_S)
        except (ChannelError, BadInput) as error:
            await end_processes(record)
            record.change_state(MissionState.FAILED, str(error))
            raise ServiceError(
                "start_failed",
                f"Mission {record.id} could not be started: {error}.",
                HTTPStatus.SERVICE_UNAVAILABLE,
            ) from error
        record.host = planner
        record.started_at = record.started_at or datetime.now(UTC)
        if record.state is MissionState.ENDED:
            # A mission can be so short that it is over before its start has been answered.
            await end_processes(record)
            return
        held = record.state is MissionState.HELD
        record.change_state(MissionState.HELD if held else MissionState.RUNNING)

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
                f"The {_WORDS[role]} process has ended unexpectedly. Vehicles hold by themselves.",
                role,
            )

        task = asyncio.create_task(run(), name=f"{record.id} {role}")
        record.tasks.add(task)
        task.add_done_callback(ended)


def conflict(record: MissionRecord, what: str) -> ServiceError:
    """Return the refusal of what cannot be done in a mission's state."""
    return ServiceError(
        "wrong_state",
        f"Mission {record.id} is {record.state} and {what}.",
        HTTPStatus.CONFLICT,
        {"state": record.state.value},
    )


def another_flies(mission_id: str) -> ServiceError:
    """Return the refusal of a mission while another one is live."""
    return ServiceError(
        "mission_live",
        f"Mission {mission_id} is live; one server flies one mission at a time.",
        HTTPStatus.CONFLICT,
        {"live_mission": mission_id},
    )


async def end_processes(record: MissionRecord) -> None:
    """End a mission's processes and wait until they are gone."""
    record.host = None
    tasks = tuple(record.tasks)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
