"""The simulated world as a process of its own: `python -m vehicles.sim_worker`.

A job is one line of JSON (`SimulationJob`), read from standard input or from a file. Standard
output says `{"type": "ready", ...}` once all robots are announced, and nothing else; the log goes
to standard error. With `--until-eof` the process ends when its standard input is closed, so that
it cannot outlive the parent that holds the other end.

Exit codes: 0 ended as asked, 1 the bus or another agent prevented it, 2 the job makes no sense.
"""

import argparse
import asyncio
import contextlib
import json
import logging
import signal
import sys
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from threading import Lock
from uuid import uuid4

from solver import engines
from solver.planner import Planner
from solver.problem import Budget, Problem, Solution
from vehicles.agent import DuplicateRobotError
from vehicles.bus import BusError
from vehicles.keys import TeamKeys
from vehicles.lifeline import end_within
from vehicles.logs import configure_logs
from vehicles.onboard import OnboardPilot
from vehicles.sim_job import SimulationJob, load_job
from vehicles.simulation import Simulation
from vehicles.zenoh_bus import ZenohBus

MAX_JOB = 64 << 20
"""Bytes of the longest job; replayed tracks are long."""


class Lifetime(StrEnum):
    """What ends the process, beside a signal."""

    SIGNAL = "signal"
    STDIN = "stdin"
    """The end of standard input."""


class SharedPlanner:
    """One planner for the pilots of a process: an engine takes one call at a time."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._lock = Lock()

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        """Return what the planner returns, when it is free."""
        with self._lock:
            return self._planner.solve(problem, budget)


async def simulate(job: SimulationJob) -> None:
    """Run a job until cancelled; say on standard output when it is ready.

    Raises:
        BusError: Nobody answers where the job says.
        DuplicateRobotError: A robot of the world is flown by another agent already.
        ValueError: The team's name or the engine's does not do.
    """
    keys = TeamKeys(job.team)
    engine = await asyncio.to_thread(engines.create, job.engine or engines.default_engine())
    planner = SharedPlanner(Planner(engine))
    async with ZenohBus(job.zenoh, keys.delivery) as bus:
        simulation = Simulation(
            job.world,
            job.simulation,
            bus,
            keys,
            lambda robot_id: OnboardPilot(robot_id, planner),
            boot=uuid4().hex[:16],
        )
        async with simulation:
            external = job.simulation.external
            robots = [robot.id for robot in job.world.robots if robot.id not in external]
            ready = {"type": "ready", "robots": robots}
            sys.stdout.write(json.dumps(ready) + "\n")
            sys.stdout.flush()
            await simulation.run()


async def _stdin() -> asyncio.StreamReader:
    reader = asyncio.StreamReader(limit=MAX_JOB)
    protocol = asyncio.StreamReaderProtocol(reader)
    await asyncio.get_running_loop().connect_read_pipe(lambda: protocol, sys.stdin)
    return reader


async def _ended(stdin: asyncio.StreamReader | None) -> None:
    """Return when standard input is closed; never without one."""
    if stdin is None:
        await asyncio.get_running_loop().create_future()
        return
    while await stdin.read(1 << 16):
        pass


async def run(job_file: Path | None, lifetime: Lifetime, preload: str | None = None) -> None:
    """Read the job and simulate it until a signal, or the end of standard input if asked."""
    if preload is not None:
        with contextlib.suppress(engines.EngineUnavailable):  # the job's own engine may do
            await asyncio.to_thread(engines.preload, preload)
    stdin = await _stdin() if job_file is None or lifetime is Lifetime.STDIN else None
    if job_file is not None:
        text = await asyncio.to_thread(job_file.read_bytes)
    else:
        text = b"" if stdin is None else await stdin.readline()
    job = load_job(text)
    working = asyncio.ensure_future(simulate(job))
    ending = asyncio.ensure_future(_ended(stdin if lifetime is Lifetime.STDIN else None))
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ending.cancel)
    try:
        await asyncio.wait({working, ending}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        end_within()
        ending.cancel()
        working.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await working


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the process; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m vehicles.sim_worker", description=__doc__)
    parser.add_argument("--job", type=Path, help="file with the job; without it, standard input")
    parser.add_argument(
        "--until-eof",
        dest="lifetime",
        action="store_const",
        const=Lifetime.STDIN,
        default=Lifetime.SIGNAL,
        help="end when standard input is closed",
    )
    parser.add_argument("--preload", metavar="ENGINE", help="load it before the job comes")
    given = parser.parse_args(arguments)
    configure_logs(libraries=logging.INFO)
    try:
        asyncio.run(run(given.job, given.lifetime, given.preload))
    except (BusError, DuplicateRobotError) as error:
        sys.stderr.write(f"sim: {error}\n")
        return 1
    except (ValueError, OSError, engines.EngineUnavailable) as error:
        sys.stderr.write(f"sim: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
