"""The mission process: `python -m server.live.worker`, started by the web side.

Standard input and output are the channel (server.live.channel); logs go to standard error. It
is asked `prepare` with a job (bus, engine and model are opened; the answer names the bus's
endpoint), then `start`, then whatever people want. End of file on standard input ends it.
"""

import asyncio
import contextlib
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any, Final
from urllib.parse import urlsplit
from uuid import uuid4

import structlog

from server.exact import ExactSolver
from server.live.channel import MAX_LINE_BYTES, Json, RequestRefused, Responder
from server.live.job import JobError, PlannerJob, load_job
from server.live.mission import ITERATIONS, LiveMission, Terms
from server.live.solving import SolveThread
from server.logs import configure_logs
from server.mission.core import MissionCore
from server.mission.tape import NoTape, Recorder, TapedCore
from server.models import EXACT, ModelUnavailable, open_model
from server.settings import SettingsError, load_settings
from solver import engines
from solver.planner import Planner
from solver.problem import Budget
from vehicles.bus import BusError
from vehicles.keys import TeamKeys
from vehicles.lifeline import end_within
from vehicles.link_monitor import LinkSettings
from vehicles.team_link import TeamLink
from vehicles.zenoh_bus import ZenohBus

log = structlog.get_logger(__name__)

HOSTED_TIMEOUT_S: Final = 8.0
LOCAL_TIMEOUT_S: Final = 30.0
"""A model on this machine shares its processor with us."""

LOCAL_HOSTS: Final = frozenset({"127.0.0.1", "localhost", "::1"})

SWITCH_S: Final = 0.001
"""How long another thread may keep the interpreter from the tick."""

_CANNOT_START = (
    BusError,
    JobError,
    ModelUnavailable,
    SettingsError,
    ValueError,
    engines.EngineUnavailable,
)


class Worker:
    """Owner of the one mission of this process."""

    def __init__(self, recorder: Recorder | None = None) -> None:
        self._recorder = recorder or NoTape()
        loop = asyncio.get_running_loop()
        self._job: asyncio.Future[PlannerJob] = loop.create_future()
        self._prepared: asyncio.Future[str] = loop.create_future()
        self._go = asyncio.Event()
        self._mission: LiveMission | None = None

    async def handle(self, op: str, params: Json) -> Json:
        """Answer one request of the web side. Raises RequestRefused."""
        if op == "prepare":
            return await self._prepare(params)
        if op == "start":
            return await self._start()
        mission = self._mission
        if mission is None or not self._go.is_set():
            raise RequestRefused("not_flying", "the mission has not started")
        author = str(params.get("author", "operator"))
        match op:
            case "hold":
                return mission.hold(author)
            case "resume":
                return mission.resume(author)
            case "pause":
                return mission.pause(author)
            case "comment":
                return mission.comment(str(params["text"]), author)
            case "result":
                return mission.result()
            case "stop":
                return await mission.stop(author)
            case _:
                raise RequestRefused("unknown_request", f"there is no request {op[:40]}")

    async def fly(self, tell: Responder) -> None:
        """Wait for the job, open what it needs, fly it."""
        job = await self._job
        try:
            async with self._opened(job, tell) as (mission, endpoint):
                self._mission = mission
                self._prepared.set_result(endpoint)
                await self._go.wait()
                await mission.run()
        except _CANNOT_START as error:
            if self._prepared.done():
                raise
            self._prepared.set_exception(RequestRefused("start_failed", str(error)))

    async def _prepare(self, params: Json) -> Json:
        if self._job.done():
            raise RequestRefused("wrong_state", "this process has its mission already")
        try:
            job = load_job(params["job"])
        except JobError as error:
            raise RequestRefused("start_failed", str(error)) from error
        if endpoint := params.get("endpoint"):
            job = replace(job, bus=replace(job.bus, listen=(str(endpoint),)))
        self._mission_id = str(params["mission"])
        self._job.set_result(job)
        return {"endpoint": await self._prepared}

    async def _start(self) -> Json:
        if self._mission is None:
            raise RequestRefused("wrong_state", "the mission must be prepared first")
        self._go.set()
        return {"state": "running"}

    @asynccontextmanager
    async def _opened(
        self, job: PlannerJob, tell: Responder
    ) -> AsyncIterator[tuple[LiveMission, str]]:
        """Open bus, engine and model; yield the mission and where vehicles reach it."""
        setup = job.setup
        keys = TeamKeys(setup.team)
        now = asyncio.get_running_loop().time
        chosen = setup.planner.engine
        planner = await asyncio.to_thread(_warm_planner, chosen, MissionCore(setup))
        core = TapedCore(MissionCore(setup), self._recorder)
        settings = LinkSettings(lost_after_s=setup.lost_after_s)
        terms = Terms(
            mission=self._mission_id,
            model_timeout_s=_timeout_s(job.llm),
            comments=job.comments,
        )
        async with (
            ZenohBus(job.bus, keys.delivery) as bus,
            TeamLink(bus, keys, setup.robot_ids, uuid4().hex[:16], now, settings) as link,
            open_model(job.llm, load_settings()) as model,
        ):
            with SolveThread(planner) as solver:
                adviser = ExactSolver(setup) if job.llm == EXACT else model
                mission = LiveMission(terms, core, solver, link, adviser, tell.push, now)
                endpoint = next(iter((*bus.endpoints, *job.bus.connect)))
                yield mission, endpoint


def _warm_planner(engine: str | None, core: MissionCore) -> Planner:
    """Return a planner whose kernels are loaded: the first solve must not be the slowest."""
    planner = Planner(engines.create(engine or engines.default_engine()))
    planner.solve(core.begin(0.0), Budget(iterations=ITERATIONS))
    return planner


def _timeout_s(llm: str) -> float:
    return LOCAL_TIMEOUT_S if urlsplit(llm).hostname in LOCAL_HOSTS else HOSTED_TIMEOUT_S


async def serve(worker_input: Any, worker_output: Any) -> None:
    """Serve one mission over two pipes until the input ends."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(limit=MAX_LINE_BYTES)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), worker_input)
    transport, protocol = await loop.connect_write_pipe(
        lambda: asyncio.streams.FlowControlMixin(), worker_output
    )
    writer = asyncio.StreamWriter(transport, protocol, None, loop)
    worker = Worker()
    responder = Responder(reader, writer, worker.handle)
    flight = asyncio.create_task(worker.fly(responder), name="flight")
    serving = asyncio.create_task(responder.run(), name="channel")
    try:
        await asyncio.wait({flight, serving}, return_when=asyncio.FIRST_COMPLETED)
        if flight.done():
            flight.result()
            await serving  # figures may still be asked for
        else:
            serving.result()
    finally:
        end_within()
        for task in (flight, serving):
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(flight, serving, return_exceptions=True)
        writer.close()


def main() -> None:
    """Run the process. Standard output is taken from everybody else: libraries print there."""
    configure_logs()
    sys.setswitchinterval(SWITCH_S)
    channel = os.fdopen(os.dup(sys.stdout.fileno()), "wb", buffering=0)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    asyncio.run(serve(sys.stdin, channel))


if __name__ == "__main__":
    main()
