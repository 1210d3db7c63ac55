"""Engines side by side on the same ticks, in one run.

    python -m benchmarks.optimizer [--quick] [--json FILE] [--picture FILE] [--deadline]

Missions of growing size at constant density (`missions.py`) are flown with the fast engine;
each tick's problem goes to every engine in turn, so that whatever disturbs the machine
disturbs all of them alike. Times are CPU time of the thread. Expressions and solvers are built
before the clock starts. `ipopt` solves the slack form from the shifted last plan, options as
in `solver/engines/ipopt.py`; `sqp` the reduced form from the same plan. Gaps are those of the
exact, unsmoothed objective to the best of eight starts of `ipopt`.
"""

import argparse
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.missions import Layout, ticks
from benchmarks.report import Row, draw, growth, machine, table, write_json
from solver import engines
from solver.engines.ipopt import IpoptEngine
from solver.objective import exact_cost
from solver.problem import Budget, Dynamics, Engine, EngineFailed, Problem, Rung

_SIZES = ((2, 2), (4, 8), (8, 16), (16, 32), (32, 64), (64, 128), (256, 512), (1000, 2000))
_HORIZONS = (1, 5, 10)
_WARM_UP = 5
"""First ticks, whose plans start from nothing, are not counted."""

_MOST_STEPS = {"ipopt": 48, "sqp": 160}
"""Robots times horizon up to which the reference engines are asked at all."""

_GAP_STEPS = 40
_LIMIT = 3e-4


@dataclass(frozen=True, slots=True)
class Case:
    """One size, horizon and kind of motion."""

    robots: int
    targets: int
    horizon: int
    dynamics: Dynamics
    ticks: int
    compared: int
    """Ticks on which the reference engines are asked too."""


@dataclass(slots=True)
class _Record:
    """What one engine did over the ticks of one case."""

    seconds: list[float] = field(default_factory=list)
    converged: int = 0
    failed: int = 0
    gaps: list[float] = field(default_factory=list)

    def row(self, case: Case, name: str) -> Row:
        times = 1e3 * np.array(self.seconds)
        gaps = np.array(self.gaps)
        return Row(
            engine=name,
            robots=case.robots,
            targets=case.targets,
            horizon=case.horizon,
            dynamics=case.dynamics.value,
            solves=len(times) + self.failed,
            median_ms=float(np.median(times)),
            p95_ms=float(np.percentile(times, 95)),
            p99_ms=float(np.percentile(times, 99)),
            max_ms=float(times.max()),
            converged=self.converged / (len(times) + self.failed),
            gap_median=float(np.median(gaps)) if len(gaps) else None,
            gap_p99=float(np.percentile(gaps, 99)) if len(gaps) else None,
            within=float((gaps <= _LIMIT).mean()) if len(gaps) else None,
        )


def cases(quick: bool) -> list[Case]:  # noqa: FBT001 (a command-line flag)
    """Return what is to be measured, small cases first."""
    result = []
    for dynamics in Dynamics:
        for horizon in _HORIZONS:
            for robots, targets in _SIZES:
                double = dynamics is Dynamics.DOUBLE_INTEGRATOR
                if double and (horizon != 5 or robots not in {4, 64}):
                    continue
                if horizon == 10 and robots > 256:
                    continue
                count = 300 if robots <= 64 else 100 if robots <= 256 else 40
                size = robots * horizon
                compared = 100 if size <= 8 else 30 if size <= _GAP_STEPS and robots < 32 else 10
                if quick:
                    count, compared = count // 10, max(3, compared // 10)
                result.append(Case(robots, targets, horizon, dynamics, count, compared))
    return result


def measure(case: Case, fleet: dict[str, Engine], budget: Budget) -> list[Row]:
    """Fly one mission and return a row per engine that took part."""
    layout = Layout(case.robots, case.targets, case.horizon, case.dynamics, seed=case.robots)
    size = case.robots * case.horizon
    taking_part = [name for name in fleet if size <= _MOST_STEPS.get(name, size)]
    records = {name: _Record() for name in taking_part}
    fast = fleet["fast"]
    oracle = fleet["ipopt"] if size <= _GAP_STEPS else None
    every = max(1, case.ticks // case.compared)
    flight = ticks(layout, case.ticks + _WARM_UP, lambda problem: fast.solve(problem, budget))
    for tick, (problem, _) in enumerate(flight):
        if tick < _WARM_UP:
            for name in taking_part:
                _solve(fleet[name], problem, budget, _Record())
            continue
        turn = (tick - _WARM_UP) % every == 0
        least = None
        if turn and isinstance(oracle, IpoptEngine):
            least = exact_cost(problem, oracle.best_of_starts(problem, 8, tick).controls)
        for name in taking_part:
            if name == "fast" or turn:
                cost = _solve(fleet[name], problem, budget, records[name])
                if least is not None and cost is not None:
                    records[name].gaps.append(cost / least - 1.0)
    return [records[name].row(case, name) for name in taking_part if records[name].seconds]


def _solve(engine: Engine, problem: Problem, budget: Budget, record: _Record) -> float | None:
    """Solve once against the clock; return the exact cost, None where the engine failed."""
    began = time.thread_time()
    try:
        found = engine.solve(problem, budget)
    except EngineFailed:
        record.failed += 1
        return None
    record.seconds.append(time.thread_time() - began)
    record.converged += found.rung is Rung.CONVERGED
    return exact_cost(problem, found.controls)


def main(arguments: list[str]) -> int:
    """Measure, print the table, write what was asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.optimizer")
    parser.add_argument("--quick", action="store_true", help="a tenth of the ticks")
    parser.add_argument("--most-robots", type=int, default=1000)
    parser.add_argument("--deadline", type=float, help="milliseconds; iterations alone without it")
    parser.add_argument("--json", type=Path, help="where to write all figures")
    parser.add_argument("--picture", type=Path, help="where to draw them (SVG)")
    options = parser.parse_args(arguments)
    deadline = None if options.deadline is None else 1e-3 * options.deadline
    budget = Budget(iterations=500, deadline_s=deadline)
    fleet = {name: engines.create(name) for name in engines.names()}
    rows: list[Row] = []
    for case in cases(options.quick):
        if case.robots <= options.most_robots:
            rows += measure(case, fleet, budget)
            sys.stderr.write(f"{case.robots}, {case.targets}, {case.horizon} steps\n")
    sys.stdout.write(f"{machine()}\n\n{table(rows)}\n\n")
    for horizon in _HORIZONS:
        exponent = growth(rows, horizon)
        if exponent is not None:
            sys.stdout.write(f"fast, {horizon} steps: time grows as robots^{exponent:.2f}\n")
    if options.json:
        write_json(options.json, rows)
    if options.picture:
        draw(options.picture, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
