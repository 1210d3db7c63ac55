"""How the tick of the core grows with the team (estimate, hazards, optimize, snapshot).

Generated missions of constant density, flown in lockstep without advice. What is told is the
processor time of the thread that ticks, so that a busy machine disturbs it little.
"""

import asyncio
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from server.experiments.campaign import Done
from server.experiments.figures import Line, lines
from server.experiments.generation import Layout, generated
from server.experiments.statistics import estimate
from server.experiments.tables import Cell, Column, Table
from server.lockstep.council import Council
from server.lockstep.driver import Lockstep
from server.mission.core import MissionCore
from server.mission.setup import GateMode
from server.mission.tape import NoTape, TapedCore
from solver import engines
from solver.planner import Planner
from solver.problem import Problem, Solution
from solver.setpoints import Setpoint
from solver.streams import Streams
from vehicles.world.world import World

TARGETS_PER_ROBOT = 2
ROBOTS_PER_ZONE = 2
WARM_UP = 5
"""Ticks at the start that are not counted: everybody begins without a plan."""

SMALLEST = 2
MOST_ZONES = 256
"""A scenario has no more."""


class TimedCore(TapedCore):
    """A core that counts each tick by its parts; what lies between them is the solve."""

    def __init__(self, core: MissionCore) -> None:
        super().__init__(core, NoTape())
        self.estimate_s: list[float] = []
        self.optimize_s: list[float] = []
        self.commit_s: list[float] = []
        self._begun_s = 0.0

    def begin(self, now_s: float) -> Problem:
        """Begin the tick and count it."""
        began_s = time.thread_time()
        problem = super().begin(now_s)
        self._begun_s = time.thread_time()
        self.estimate_s.append(self._begun_s - began_s)
        return problem

    def commit(self, solution: Solution) -> tuple[Setpoint, ...]:
        """Commit the tick and count it."""
        solved_s = time.thread_time()
        setpoints = super().commit(solution)
        self.optimize_s.append(solved_s - self._begun_s)
        self.commit_s.append(time.thread_time() - solved_s)
        return setpoints


@dataclass(frozen=True, slots=True)
class ScalingTrial:
    """One team size under one seed."""

    layout: Layout
    seed: int
    engine: str

    @property
    def label(self) -> str:
        """Size and seed."""
        return f"{self.layout.robots}-robots-seed-{self.seed}"

    def identity(self) -> Mapping[str, Any]:
        """Return what decides the mission; the machine is not known to it."""
        layout = self.layout
        return {
            "kind": "scaling",
            "robots": layout.robots,
            "targets": layout.targets,
            "zones": layout.zones,
            "steps": layout.steps,
            "seed": self.seed,
            "engine": self.engine,
        }

    def perform(self) -> dict[str, Any]:
        """Fly it; return times in milliseconds, of the ticks after the warm-up."""
        scenario = generated(self.layout, self.seed)
        setup, world = scenario.mission_setup(self.engine), scenario.world_setup()
        core = TimedCore(MissionCore(setup))
        planner = Planner(engines.create(self.engine))
        council = Council(core, GateMode.OFF, Planner(engines.create(self.engine)))
        mission = Lockstep(setup, World(world, Streams(self.seed)), council, planner, None)
        asyncio.run(mission.run(lambda _: None))
        parts = {
            "estimate": core.estimate_s,
            "optimize": core.optimize_s,
            "commit": core.commit_s,
        }
        ticks = np.sum(list(parts.values()), axis=0)[WARM_UP:]
        return {
            "median_ms": 1e3 * float(np.median(ticks)),
            "p99_ms": 1e3 * float(np.percentile(ticks, 99)),
            "ticks": len(ticks),
            **{f"{name}_ms": _median_ms(values) for name, values in parts.items()},
        }


@dataclass(frozen=True, slots=True)
class ScalingPlan:
    """What is flown."""

    largest: int
    seeds: tuple[int, ...]
    engine: str
    steps: int

    @property
    def title(self) -> str:
        """What the report is called."""
        return "Time of a tick by team size"

    @property
    def notes(self) -> str:
        """What a reader of the table should know."""
        return (
            f"Engine {self.engine}, {TARGETS_PER_ROBOT} targets per robot, constant density, "
            f"{len(self.seeds)} seeds, {self.steps - WARM_UP} ticks each after {WARM_UP} of "
            "warm-up. Processor time of the ticking thread; nobody advises."
        )

    def sizes(self) -> tuple[int, ...]:
        """Return the numbers of robots: doubled from two on, and the largest."""
        sizes = []
        size = SMALLEST
        while size < self.largest:
            sizes.append(size)
            size *= 2
        return (*sizes, self.largest)

    def trials(self) -> list[ScalingTrial]:
        """Return every run, the largest first: they take the longest."""
        return [
            ScalingTrial(layout(size, self.steps), seed, self.engine)
            for size in reversed(self.sizes())
            for seed in self.seeds
        ]


def layout(robots: int, steps: int) -> Layout:
    """Return the layout of a team size."""
    zones = min(MOST_ZONES, max(2, robots // ROBOTS_PER_ZONE))
    return Layout(robots, TARGETS_PER_ROBOT * robots, zones, steps=steps)


@dataclass(frozen=True, slots=True)
class Scaling:
    """The times by size, and the table made of them."""

    plan: ScalingPlan
    times: Mapping[int, list[Mapping[str, float]]]
    """Robots -> one record per seed."""

    @classmethod
    def of(cls, plan: ScalingPlan, finished: Iterable[Done]) -> "Scaling":
        """Gather the times."""
        times: dict[int, list[Mapping[str, float]]] = {size: [] for size in plan.sizes()}
        for done in finished:
            if isinstance(done.trial, ScalingTrial):
                times[done.trial.layout.robots].append(done.result)
        return cls(plan, {size: found for size, found in times.items() if found})

    def table(self) -> Table:
        """Return the times by size, means over the seeds."""
        rows: list[dict[str, Cell]] = []
        for size, found in self.times.items():
            row: dict[str, Cell] = {"robots": size, "targets": TARGETS_PER_ROBOT * size}
            for column in _TIMES:
                row[column.key] = estimate([record[column.key] for record in found])
            median = estimate([record["median_ms"] for record in found])
            row["per_robot_us"] = None if median is None else 1e3 * median.mean / size
            rows.append(row)
        heads = (Column("robots", "robots"), Column("targets", "targets"))
        return Table("Milliseconds per tick", (*heads, *_TIMES, _PER_ROBOT), rows)

    def tables(self) -> dict[str, Table]:
        """Return every table by the name of its file."""
        return {"scaling": self.table()}

    def draw(self) -> dict[str, bytes]:
        """Return the figure as PNG by the name of its file."""
        sizes = list(self.times)
        curves = [
            Line(column.head, sizes, [_mean(self.times[size], column.key) for size in sizes])
            for column in _TIMES
        ]
        first = curves[0].y[0] / sizes[0]
        curves.append(Line("linear", sizes, [first * size for size in sizes], dashed=True))
        return {"scaling": lines(curves, ("robots", "ms per tick"), self.plan.title)}

    def as_json(self) -> dict[str, Any]:
        """Return what was flown and the table as plain records."""
        return {
            "experiment": "scaling",
            "engine": self.plan.engine,
            "seeds": list(self.plan.seeds),
            "steps": self.plan.steps,
            "tables": {name: table.records() for name, table in self.tables().items()},
        }


_TIMES = (
    Column("median_ms", "median tick", 2),
    Column("p99_ms", "p99", 2),
    Column("estimate_ms", "estimate", 2),
    Column("optimize_ms", "optimize", 2),
    Column("commit_ms", "snapshot", 2),
)
_PER_ROBOT = Column("per_robot_us", "µs per robot", 0)


def _median_ms(seconds: list[float]) -> float:
    return 1e3 * float(np.median(seconds[WARM_UP:]))


def _mean(found: list[Mapping[str, float]], key: str) -> float:
    return float(np.mean([record[key] for record in found]))
