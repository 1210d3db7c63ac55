"""One tick of the whole mission core: estimate, hazards, optimize, snapshot.

Missions are flown in lockstep by the simulated world. Timed, in CPU time of the thread, is what
the core does in a tick: `begin` (estimates, what is known of zones, the problem), the solve,
and `commit` (setpoints, snapshot); not the world, nor what robots do on board.
"""

import asyncio
import gc
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from server.lockstep.council import Council
from server.lockstep.driver import LOCKSTEP_BUDGET, Lockstep
from server.mission.core import MissionCore
from server.mission.setup import GateMode
from server.mission.tape import NoTape, TapedCore
from server.scenarios import library
from server.scenarios.schema import Scenario
from solver import engines
from solver.arrays import FloatArray
from solver.planner import Planner
from solver.problem import Budget, Problem, Solution
from solver.setpoints import Setpoint
from solver.streams import Streams
from vehicles.world.world import World

NAMES = ("ablation", "four-by-eight")
CROWDS = ((8, 16), (16, 32), (64, 128))
_WARM_UP = 10
_AREA_PER_ROBOT = 50.0
_APART_M = 0.6
_MOST_ZONES = 256
"""As many as a scenario may have."""


@dataclass(frozen=True, slots=True)
class Tick:
    """Figures of one mission, milliseconds."""

    name: str
    robots: int
    targets: int
    horizon: int
    ticks: int
    median_ms: float
    p99_ms: float
    max_ms: float
    solve_median_ms: float


class _TimedPlanner(Planner):
    """Remembers how long the last solve took."""

    spent_s = 0.0

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        began = time.thread_time()
        solution = super().solve(problem, budget)
        self.spent_s = time.thread_time() - began
        return solution


class _TimedCore(TapedCore):
    """Remembers how long every tick took, with its solve."""

    def __init__(self, core: MissionCore, planner: _TimedPlanner) -> None:
        super().__init__(core, NoTape())
        self._planner = planner
        self._begun_s = 0.0
        self.ticks_s: list[tuple[float, float]] = []

    def begin(self, now_s: float) -> Problem:
        began = time.thread_time()
        problem = super().begin(now_s)
        self._begun_s = time.thread_time() - began
        return problem

    def commit(self, solution: Solution) -> tuple[Setpoint, ...]:
        began = time.thread_time()
        setpoints = super().commit(solution)
        committed_s = time.thread_time() - began
        solve_s = self._planner.spent_s
        self.ticks_s.append((self._begun_s + solve_s + committed_s, solve_s))
        return setpoints


def crowd(robots: int, targets: int) -> Scenario:
    """Return a scenario of any size at constant density: targets on circles, zones about."""
    dice = np.random.default_rng(robots)
    half = 0.5 * float(np.sqrt(_AREA_PER_ROBOT * robots))
    spots = dice.uniform(
        -0.9 * half, 0.9 * half, (robots + targets + min(robots // 2, _MOST_ZONES), 2)
    ).round(3)
    _part(spots[:robots], 0.9 * half, np.random.default_rng(robots))
    places = [spot.tolist() for spot in spots]
    where, centres = places[robots : robots + targets], places[robots + targets :]
    robot_ids = list(range(1, robots + 1))
    target_ids = list(range(1001, 1001 + targets))
    assignment: dict[int, list[int]] = {robot_id: [] for robot_id in robot_ids}
    gaps = np.hypot(*(spots[:robots, None] - spots[None, robots : robots + targets]).T).T
    for j in range(targets):
        free = [i for i in np.argsort(gaps[:, j]) if len(assignment[robot_ids[i]]) < 3]
        assignment[robot_ids[free[0]]].append(target_ids[j])
    small = [[0.4, 0.0], [0.0, 0.4]]
    return library.inline(
        {
            "name": f"crowd-{robots}",
            "seed": 0,
            "tick_s": 0.1,
            "steps": 300,
            "field": {"lower": [-half, -half], "upper": [half, half]},
            "robots": [
                {"id": robot_id, "position": place, "altitude_m": 1.0, "capacity": 3}
                for robot_id, place in zip(robot_ids, places, strict=False)
            ],
            "targets": [
                {
                    "id": target_id,
                    "position": place,
                    "motion": {
                        "kind": "circle",
                        "centre": [place[0] - 1.0, place[1]],
                        "rate_rad_s": 0.1,
                    },
                    "prior": {"mean": place, "covariance": [[0.25, 0.0], [0.0, 0.25]]},
                }
                for target_id, place in zip(target_ids, where, strict=True)
            ],
            "zones": [
                {
                    "id": f"z{number}",
                    "kind": "sensing" if number % 2 else "communication",
                    "mean": centre,
                    "covariance": small,
                }
                for number, centre in enumerate(centres)
            ],
            "zone_defaults": {
                "communication": {"margin": 0.5 / half, "risk": 0.005, "risk_single": 0.01}
            },
            "assignment": assignment,
        }
    )


def _part(robots: FloatArray, half: float, dice: np.random.Generator) -> None:
    """Move robots (M, 2) that are too near to another one elsewhere, in place."""
    for i, spot in enumerate(robots):
        while (np.hypot(*(robots[:i] - spot).T) < _APART_M).any():
            spot[:] = dice.uniform(-half, half, 2).round(3)


def flown(scenario: Scenario, steps: int) -> Tick:
    """Fly some steps of a mission and return what its ticks took."""
    setup = scenario.mission_setup()
    setup = replace(setup, steps=min(setup.steps, steps + _WARM_UP))
    planner = _TimedPlanner(engines.create("fast"))
    planner.solve(MissionCore(setup).begin(0.0), LOCKSTEP_BUDGET)
    core = _TimedCore(MissionCore(setup), planner)
    world = World(scenario.world_setup(), Streams(setup.seed))
    council = Council(core, GateMode.OFF, planner)
    gc.collect()
    result: dict[str, Any] = asyncio.run(
        Lockstep(setup, world, council, planner, None).run(lambda _: None)
    )
    times = 1e3 * np.array(core.ticks_s[_WARM_UP:])
    return Tick(
        name=setup.name,
        robots=int(result["robots"]),
        targets=int(result["targets"]),
        horizon=setup.planner.horizon,
        ticks=len(times),
        median_ms=float(np.median(times[:, 0])),
        p99_ms=float(np.percentile(times[:, 0], 99)),
        max_ms=float(times[:, 0].max()),
        solve_median_ms=float(np.median(times[:, 1])),
    )


def ticks(steps: int) -> list[Tick]:
    """Return the figures of all missions, small ones first."""
    scenarios = [library.named(name) for name in NAMES]
    scenarios += [crowd(robots, targets) for robots, targets in CROWDS]
    return [flown(scenario, steps) for scenario in scenarios]


def table(rows: list[Tick]) -> str:
    """Return the figures as Markdown."""
    head = (
        "| mission | robots, targets | steps ahead | ticks | median | p99 | max (ms) "
        "| of it the solve, median |"
    )
    lines = [
        head,
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.name} | {row.robots}, {row.targets} | {row.horizon} | {row.ticks} "
        f"| {row.median_ms:.2f} | {row.p99_ms:.2f} | {row.max_ms:.2f} "
        f"| {row.solve_median_ms:.2f} |"
        for row in rows
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(ticks(300)))
