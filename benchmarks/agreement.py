"""Whether the fast engine finds what IPOPT finds: recorded ticks, eight starts, one table.

    python -m benchmarks.agreement [FILE.yaml ...] [--ticks N] [--horizon H] [--reference FILE]
                                   [--jobs N]

Missions are flown in lockstep (our scenarios, files named on the command line, and missions of
`missions.py`), at one step, at the horizon the scenario flies with, and at five and ten steps.
Some of their ticks are recorded, on-board problems of jammed robots among them. Each is solved
by `fast` and by `ipopt` on the slack form from eight starts: the last plan, rest, and six at
random. Compared is the exact, unsmoothed objective; the best of the eight is the one that is
lowest by it.

IPOPT takes minutes to hours. With `--reference` the ticks and what it found are kept in a file:
a run that was interrupted goes on where it stopped (`--most` interrupts it by itself), and one
that finds everything done only solves with `fast`. Delete the file to record afresh.
"""

import argparse
import asyncio
import pickle
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from benchmarks.missions import Layout, ticks
from server.cli.progress import progress_bar
from server.lockstep.council import Council
from server.lockstep.driver import LOCKSTEP_BUDGET, Lockstep
from server.mission.core import MissionCore
from server.mission.setup import GateMode
from server.mission.tape import NoTape, TapedCore
from server.scenarios import library
from solver import engines
from solver.arrays import BoolArray, FloatArray
from solver.engines.ipopt import IpoptEngine
from solver.objective import exact_cost
from solver.planner import Planner
from solver.problem import Budget, Engine, Problem, Solution
from solver.streams import Streams
from vehicles.world.world import World

SCENARIOS = ("demo", "four-by-eight", "hardware", "ablation")
LIMIT = 3e-4
STARTS = 8

_GENERATED = {(2, 2): (1, 3, 5, 10), (4, 8): (1, 3, 5, 10), (8, 16): (1, 3, 5)}
_LONGEST = 600
"""Steps of a scenario that are flown."""

_WARM_UP = 5
_KEEP_EVERY = 20
"""Ticks after which what was found is written down."""


@dataclass(frozen=True, slots=True)
class Source:
    """A mission to record from."""

    name: str
    """Of a scenario or a file; for a generated mission its size."""

    horizon: int | None
    """None for the scenario's own."""

    size: tuple[int, int] | None = None
    """Robots and targets of a generated mission."""


@dataclass(frozen=True, slots=True)
class Tick:
    """One recorded problem and the best that IPOPT found."""

    source: str
    problem: Problem
    best: float | None = None
    """Exact objective; None while IPOPT has not been asked."""

    controls: FloatArray | None = None
    """(M, H, 2), what costs that."""


class Recorder:
    """An engine that remembers what another one was asked. Satisfies `solver.problem.Engine`."""

    def __init__(self, engine: Engine) -> None:
        self.name = engine.name
        self.heard: list[Problem] = []
        self._engine = engine

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        """Solve and remember."""
        self.heard.append(problem)
        return self._engine.solve(problem, budget)


def sources(files: list[str], horizon: int | None = None) -> list[Source]:
    """Return the missions to record from, those that look so many steps ahead or all."""
    found = [Source(name, h) for name in (*SCENARIOS, *files) for h in (None, 1, 5)]
    found += [Source(name, 10) for name in ("hardware", "ablation")]
    for (robots, targets), horizons in _GENERATED.items():
        found += [Source(f"{robots}, {targets}", h, (robots, targets)) for h in horizons]
    return [source for source in found if horizon in (None, source.horizon)]


def recorded(source: Source, count: int) -> list[Problem]:
    """Fly a mission and return `count` of its problems, evenly spread."""
    recorder = Recorder(engines.create("fast"))
    if source.size is not None:
        robots, targets = source.size
        layout = Layout(robots, targets, source.horizon or 1, seed=robots + 100)
        flight = ticks(layout, 5 * count, lambda p: recorder.solve(p, LOCKSTEP_BUDGET))
        for _ in flight:
            pass
    else:
        _fly(source, recorder)
    heard = [problem for problem in recorder.heard[_WARM_UP:] if problem.robot_ids]
    chosen = np.unique(np.linspace(0, len(heard) - 1, count).astype(int))
    return [heard[at] for at in chosen]


def _fly(source: Source, engine: Engine) -> None:
    scenario = library.load(source.name)
    setup = scenario.mission_setup()
    planner = replace(setup.planner, horizon=source.horizon or setup.planner.horizon)
    setup = replace(setup, planner=planner, steps=min(setup.steps, _LONGEST))
    world = World(scenario.world_setup(), Streams(setup.seed))
    core = TapedCore(MissionCore(setup), NoTape())
    planner = Planner(engine)
    council = Council(core, GateMode.OFF, planner)
    asyncio.run(Lockstep(setup, world, council, planner, None).run(lambda _: None))


def record(files: list[str], count: int, horizon: int | None = None) -> list[Tick]:
    """Record all missions; the ticks come shuffled, so that a part of them is a fair sample."""
    missions = sources(files, horizon)
    found: list[Tick] = []
    with progress_bar("recording", len(missions)) as progress:
        for number, source in enumerate(missions):
            for problem in recorded(source, count):
                found.append(Tick(f"{Path(source.name).stem}, {problem.horizon}", problem))
            progress(number + 1)
    order = np.random.default_rng(0).permutation(len(found))
    return [found[at] for at in order]


def referenced(tick: Tick) -> Tick:
    """Return a tick with the best of eight starts of IPOPT."""
    found = _oracle().every_start(tick.problem, STARTS)
    costs = [exact_cost(tick.problem, solution.controls) for solution in found]
    best = int(np.argmin(costs))
    return replace(tick, best=costs[best], controls=found[best].controls)


@cache
def _oracle() -> IpoptEngine:
    return IpoptEngine(kept=200)


def complete(found: list[Tick], most: int, jobs: int, keep: Callable[[list[Tick]], None]) -> None:
    """Ask IPOPT about at most `most` ticks that it has not been asked about, in place."""
    open_ones = [at for at, tick in enumerate(found) if tick.best is None][:most]
    with progress_bar("ipopt", len(open_ones)) as progress, ProcessPoolExecutor(jobs) as pool:
        answers = pool.map(referenced, [found[at] for at in open_ones])
        for number, (at, tick) in enumerate(zip(open_ones, answers, strict=True), start=1):
            found[at] = tick
            progress(number)
            if number % _KEEP_EVERY == 0:
                keep(found)
    keep(found)


def gaps(found: list[Tick], engine: Engine) -> list[float]:
    """Return by how much the engine's exact objective is above the best, relative."""
    values = []
    for tick in found:
        answer = engine.solve(tick.problem, LOCKSTEP_BUDGET)
        values.append(exact_cost(tick.problem, answer.controls) / (tick.best or 1.0) - 1.0)
    return values


def table(found: list[Tick], values: list[float]) -> str:
    """Return a row per mission and horizon and rows for all of them, as Markdown."""
    lines = [
        "| mission, steps | ticks | within 3e-4 | median gap | p99 | largest | below by > 3e-4 |",
        "|---|---|---|---|---|---|---|",
    ]
    row = partial(_row, values=np.array(values))
    horizons = np.array([tick.problem.horizon for tick in found])
    names = np.array([tick.source for tick in found])
    lines += [row(name, names == name) for name in sorted(set(names.tolist()))]
    lines += [row(f"all, {h}", horizons == h) for h in sorted(set(horizons.tolist()))]
    lines.append(row("all", np.ones(len(found), np.bool_)))
    return "\n".join(lines)


def _row(name: str, chosen: BoolArray, values: FloatArray) -> str:
    own = values[chosen]
    within = f"{100.0 * (own <= LIMIT).mean():.1f} %"
    return (
        f"| {name} | {len(own)} | {within} | {np.median(own):.1e} | {np.percentile(own, 99):.1e} "
        f"| {own.max():.1e} | {100.0 * (own < -LIMIT).mean():.1f} % |"
    )


def main(arguments: list[str]) -> int:
    """Record and compare; return 1 where less than 99 % of all ticks are within the limit."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.agreement")
    parser.add_argument("files", nargs="*", help="scenarios beside our own")
    parser.add_argument("--ticks", type=int, default=24, help="per mission and horizon")
    parser.add_argument("--horizon", type=int, help="record only missions of so many steps")
    parser.add_argument("--reference", type=Path, help="where IPOPT's answers are kept")
    parser.add_argument("--most", type=int, default=sys.maxsize, help="ticks IPOPT is asked now")
    parser.add_argument("--jobs", type=int, default=1, help="processes for IPOPT")
    options = parser.parse_args(arguments)
    kept: Path | None = options.reference

    def keep(found: list[Tick]) -> None:
        if kept is not None:
            unfinished = kept.with_suffix(".part")
            unfinished.write_bytes(pickle.dumps(found))
            unfinished.replace(kept)

    if kept is not None and kept.exists():
        found: list[Tick] = pickle.loads(kept.read_bytes())
    else:
        found = record(options.files, options.ticks, options.horizon)
        keep(found)
    complete(found, options.most, options.jobs, keep)
    known = [tick for tick in found if tick.best is not None]
    values = gaps(known, engines.create("fast"))
    sys.stdout.write(f"{len(known)} of {len(found)} ticks\n\n{table(known, values)}\n")
    return 0 if np.mean(np.array(values) <= LIMIT) >= 0.99 else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
