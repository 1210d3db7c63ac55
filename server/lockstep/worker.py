"""A lockstep mission in a process of its own: `python -m server.lockstep.worker`.

It speaks the same channel as a live one (server.live.channel): `prepare` with a job, `start`,
`stop`, `result`. The mission runs in a thread, as fast as it goes; what it tells goes out by the
event loop, snapshots at most ten times a second of wall time. People cannot steer it.
"""

import asyncio
import sys
import threading
import time
from collections import Counter
from typing import Any, Final

from pydantic import ValidationError

from server.encoding import EventKind, MissionState, Severity
from server.gate.decisions import Attempt, Decision
from server.live.channel import Json, RequestRefused, Responder
from server.live.herald import Herald
from server.live.pipes import own_output, serve_pipes
from server.lockstep.assembly import Assembly
from server.lockstep.job import PAPER_LATENCY, LockstepJob, ScriptedComment, load_job
from server.loops import LoopReport
from server.models import ModelUnavailable
from server.settings import SettingsError, load_settings
from solver.engines import EngineUnavailable
from solver.snapshot import Snapshot
from solver.zones import ZoneKind
from vehicles.world.world import World

SHOW_S: Final = 0.1

_CANNOT_RUN = (EngineUnavailable, ModelUnavailable, SettingsError)


class Stopped(Exception):
    """Raised inside the run when somebody has ended it."""


class LockstepWorker:
    """Owner of the one mission of this process."""

    def __init__(self) -> None:
        self._job: LockstepJob | None = None
        self._mission = ""
        self._go = asyncio.Event()
        self._stop = threading.Event()
        self._result: Json | None = None

    async def handle(self, op: str, params: Json) -> Json:
        """Answer one request of the web side. Raises RequestRefused."""
        match op:
            case "prepare":
                return self._prepare(params)
            case "start" if self._job is not None:
                self._go.set()
                return {"state": MissionState.RUNNING.value}
            case "stop":
                self._stop.set()
                self._go.set()
                return {"result": self._result}
            case "result" if self._result is not None:
                return self._result
            case "result":
                raise RequestRefused("no_result", "a mission in lockstep has figures at its end")
            case _:
                raise RequestRefused(
                    "not_steered", "a mission in lockstep runs by itself: nobody can steer it"
                )

    async def fly(self, tell: Responder) -> None:
        """Wait for the start, run to the end, tell the result."""
        await self._go.wait()
        job = self._job
        if job is None:
            return
        loop = asyncio.get_running_loop()
        teller = _Teller(job, self._mission, lambda m: loop.call_soon_threadsafe(tell.push, m))
        try:
            self._result = await asyncio.to_thread(self._run, job, teller)
        except Stopped:
            return
        except _CANNOT_RUN as error:
            teller.end(str(error), None)
        else:
            teller.end("The mission's time is over.", self._result)

    def _prepare(self, params: Json) -> Json:
        try:
            self._job = load_job(params["job"])
        except ValidationError as error:
            fields = {".".join(map(str, e["loc"])) for e in error.errors()}
            words = f"not a job: {', '.join(sorted(fields))}"
            raise RequestRefused("start_failed", words) from error
        self._mission = str(params["mission"])
        return {"endpoint": ""}

    def _run(self, job: LockstepJob, teller: "_Teller") -> Json:
        """Run the mission in this thread, with an event loop of its own."""

        def witness(snapshot: Snapshot, _: World) -> None:
            if self._stop.is_set():
                raise Stopped
            teller.look(snapshot)

        assembly = Assembly(job.setup, job.world, job.llm, PAPER_LATENCY, load_settings())
        said = tuple(ScriptedComment(time_s, text) for time_s, text in job.comments)
        flight = assembly.run(said, lambda _: None, witness=witness, listener=teller.decide)
        return asyncio.run(flight)


class _Teller:
    """Makes messages of a run's snapshots. Used by the run's thread alone."""

    def __init__(self, job: LockstepJob, mission: str, push: Any) -> None:
        self._herald = Herald(mission, job.setup, push)
        self._hits: Counter[ZoneKind] = Counter()
        self._began_s = time.monotonic()
        self._shown_s = 0.0
        self._last: Snapshot | None = None

    def look(self, snapshot: Snapshot) -> None:
        """Tell the news of a step, and show it when it is time."""
        self._last = snapshot
        self._hits.update(attack.kind for attack in snapshot.attacks)
        self._herald.announce(snapshot)
        now_s = time.monotonic()
        if now_s >= self._shown_s + SHOW_S:
            self._shown_s = now_s
            self._show(snapshot, MissionState.RUNNING)

    def decide(self, card: Decision, attempts: tuple[Attempt, ...]) -> None:
        """Tell of a decision."""
        self._herald.decision(card, attempts)

    def end(self, words: str, result: Json | None) -> None:
        """Tell that it is over."""
        if self._last is not None:
            self._show(self._last, MissionState.ENDED)
        data = {} if result is None else {"result": result}
        severity = Severity.INFO if result is not None else Severity.ALARM
        self._herald.say(EventKind.ENDED, severity, words, data)

    def _show(self, snapshot: Snapshot, state: MissionState) -> None:
        wall_s = max(1e-9, time.monotonic() - self._began_s)
        ticks = snapshot.tick + 1
        report = LoopReport(ticks, 0, ticks / wall_s, wall_s / ticks, 1.0, 0.0)
        self._herald.show(snapshot, state, {"optimizer": report}, self._hits, None)


def main() -> None:
    """Run the process."""
    asyncio.run(_serve())


async def _serve() -> None:
    worker = LockstepWorker()
    await serve_pipes(worker.handle, worker.fly, sys.stdin, own_output())


if __name__ == "__main__":
    main()
