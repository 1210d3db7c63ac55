"""The mission process: `python -m server.live.worker`, started by the web side.

Standard input and output are the channel (server.live.channel); logs go to standard error. It
is asked `prepare` with a job (bus, engine and model are opened; the answer names the bus's
endpoint), then `start`, then whatever people want. End of file on standard input ends it.
"""

import argparse
import asyncio
import contextlib
import gc
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any, Final
from uuid import uuid4

import structlog

from server.exact import ExactSolver
from server.live.channel import Json, RequestRefused, Responder
from server.live.forecasting import ForecastThread
from server.live.job import JobError, PlannerJob, load_job
from server.live.mission import ITERATIONS, LiveMission, Terms
from server.live.pipes import own_output, serve_pipes
from server.live.recording import open_recorder
from server.live.solving import SolveThread
from server.live.vitals import report_vitals
from server.mission.core import MissionCore
from server.mission.tape import TapedCore
from server.models import EXACT, ModelUnavailable, manner_of, open_model
from server.recording.errors import RecordingError
from server.settings import SettingsError, load_settings
from solver import engines
from solver.planner import Planner
from solver.problem import Budget
from vehicles.bus import BusError
from vehicles.keys import TeamKeys
from vehicles.link_monitor import LinkSettings
from vehicles.team_link import TeamLink
from vehicles.zenoh_bus import ZenohBus

log = structlog.get_logger(__name__)

SWITCH_S: Final = 0.001
"""How long another thread may keep the interpreter from the tick."""

_CANNOT_START = (
    BusError,
    JobError,
    ModelUnavailable,
    RecordingError,
    SettingsError,
    ValueError,
    engines.EngineUnavailable,
)


class Worker:
    """Owner of the one mission of this process."""

    def __init__(self, preload: str | None = None) -> None:
        loop = asyncio.get_running_loop()
        self._preload = preload
        self._job: asyncio.Future[PlannerJob] = loop.create_future()
        self._prepared: asyncio.Future[str] = loop.create_future()
        self._go = asyncio.Event()
        self._mission: LiveMission | None = None
        self._mission_id = ""
        self._decisions_made = 0
        self._recording: str | None = None

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
                return mission.comment(str(params["text"]), author, str(params["id"]))
            case "override":
                return await mission.override(str(params["what"]), params["asked"], author)
            case "checkpoint":
                return mission.checkpoint()
            case "result":
                return mission.result()
            case "stop":
                return await mission.stop(author)
            case _:
                raise RequestRefused("unknown_request", f"there is no request {op[:40]}")

    async def fly(self, tell: Responder) -> None:
        """Wait for the job, open what it needs, fly it."""
        if self._preload is not None:
            with contextlib.suppress(engines.EngineUnavailable):  # the job's own engine may do
                await asyncio.to_thread(engines.preload, self._preload)
        job = await self._job
        try:
            async with self._opened(job, tell) as (mission, endpoint):
                self._mission = mission
                self._prepared.set_result(endpoint)
                await self._go.wait()
                await self._run(mission, tell)
        except _CANNOT_START as error:
            if self._prepared.done():
                raise
            self._prepared.set_exception(RequestRefused("start_failed", str(error)))

    async def _run(self, mission: LiveMission, tell: Responder) -> None:
        """Fly, and tell meanwhile how this process does."""

        def counters() -> dict[str, int]:
            return {"events_to_web": tell.lost_events, "bus_messages": mission.refused}

        vitals = asyncio.create_task(report_vitals(tell.push, mission.tallies, counters))
        try:
            await mission.run()
        finally:
            vitals.cancel()

    async def _prepare(self, params: Json) -> Json:
        if self._job.done():
            raise RequestRefused("wrong_state", "this process has its mission already")
        try:
            job = load_job(params["job"])
        except JobError as error:
            raise RequestRefused("start_failed", str(error)) from error
        # The same port again, where the system chose one. Who connects to a router does not listen.
        endpoint = params.get("endpoint")
        if endpoint is not None and job.bus.has_free_port:
            job = replace(job, bus=replace(job.bus, listen=(str(endpoint),)))
        self._mission_id = str(params["mission"])
        structlog.contextvars.bind_contextvars(mission=self._mission_id)
        self._decisions_made = int(params.get("decisions", 0))
        self._job.set_result(job)
        endpoint = await self._prepared
        return {"endpoint": endpoint, "recording": self._recording}

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
        planner = await asyncio.to_thread(warm_planner, chosen, MissionCore(setup))
        settings = LinkSettings(lost_after_s=setup.lost_after_s)
        terms = Terms(
            mission=self._mission_id,
            manner=manner_of(job.llm),
            comments=job.comments,
            decisions_made=self._decisions_made,
            comments_said=job.comments_said,
            figures=job.figures,
        )
        async with (
            ZenohBus(job.bus, keys.delivery) as bus,
            TeamLink(bus, keys, setup.robot_ids, uuid4().hex[:16], now, settings) as link,
            open_model(job.llm, load_settings(), log.info) as model,
            open_recorder(self._mission_id, job) as recorder,
        ):
            core = TapedCore(MissionCore(setup), recorder.tape)
            self._recording = None if recorder.path is None else str(recorder.path)
            gate = ForecastThread(Planner(engines.create(planner.engine.name)))
            with SolveThread(planner) as solver, gate:
                adviser = ExactSolver(setup) if job.llm == EXACT else model
                mission = LiveMission(
                    terms, core, solver, gate, link, adviser, tell.push, now, recorder
                )
                endpoint = next(iter((*bus.endpoints, *job.bus.connect)))
                yield mission, endpoint


def warm_planner(engine: str | None, core: MissionCore) -> Planner:
    """Return a planner whose kernels are loaded: the first solve must not be the slowest.

    What this process has loaded by now stays to its end, and is kept from the garbage collector:
    to look through all of it takes as long as a tick, and would be done in flight.
    """
    planner = Planner(engines.create(engine or engines.default_engine()))
    first_s = core.snapshot.time_s + core.setup.tick_s
    planner.solve(core.begin(first_s), Budget(iterations=ITERATIONS))
    gc.collect()
    gc.freeze()
    return planner


async def serve(worker_input: Any, worker_output: Any, preload: str | None) -> None:
    """Serve one mission over two pipes until the input ends."""
    worker = Worker(preload)
    await serve_pipes(worker.handle, worker.fly, worker_input, worker_output)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the process."""
    parser = argparse.ArgumentParser(prog="python -m server.live.worker")
    parser.add_argument("--preload", metavar="ENGINE", help="load it before the job comes")
    given = parser.parse_args(arguments)
    sys.setswitchinterval(SWITCH_S)
    asyncio.run(serve(sys.stdin, own_output(), given.preload))


if __name__ == "__main__":
    main()
