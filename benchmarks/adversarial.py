"""Problems meant to break an engine, and a program that solves very many of them.

    python -m benchmarks.adversarial [--count 100000] [--engine fast] [--seed 0]

Robots inside zones, on targets, on each other, on the edge of the field and outside it; zero
and huge covariances, zones without extent, nobody who sees, no targets, weights at both
bounds, plans from nowhere. Of each answer it is checked that it is finite, inside the hard
box, no worse than its start, and in time; late is what is late whenever it is solved again.
"""

import argparse
import sys
import time
from dataclasses import dataclass

import numpy as np

from solver import engines
from solver.arrays import FloatArray, frozen, frozen_bool
from solver.bounds import control_box
from solver.directives import Weights
from solver.objective import cost
from solver.problem import Budget, Dynamics, Engine, Problem, SensorModel, Solution, ZoneTable

_LATE_S = 0.005
_DEADLINE_S = 0.002
_AGAIN = 3
"""So often a late solve is repeated: what the machine took from the thread is not the engine's."""


def _covariances(dice: np.random.Generator, count: int) -> FloatArray:
    """Return ordinary, zero, huge, flat and indefinite matrices, (count, 2, 2)."""
    factors = dice.normal(size=(count, 2, 2))
    ordinary = factors @ np.swapaxes(factors, 1, 2)
    scale = dice.choice([0.0, 1e-9, 0.1, 1.0, 1e6], size=(count, 1, 1))
    kind = dice.integers(0, 4, size=(count, 1, 1))
    flat = factors[:, :, :1] @ np.swapaxes(factors[:, :, :1], 1, 2)
    indefinite = factors + np.swapaxes(factors, 1, 2)
    return np.asarray(scale * np.where(kind == 0, flat, np.where(kind == 1, indefinite, ordinary)))


def _zones(
    dice: np.random.Generator, count: int, robots: int, spots: FloatArray, extreme: float
) -> ZoneTable:
    factors = dice.normal(size=(count, 2, 2)) * dice.choice([0.0, 0.3, 1.0, extreme])
    return ZoneTable(
        centres=frozen(spots[dice.integers(0, len(spots), count)]),
        covariances=frozen(factors @ np.swapaxes(factors, 1, 2)),
        margins=frozen(dice.choice([0.0, 0.1, 0.5, 3.0], count)),
        quantiles=frozen(dice.choice([0.0, 0.8, 1.3, 4.0], count)),
        severities=frozen(dice.choice([1.0, 5.0], count)),
        known=frozen_bool(dice.random((robots, count)) < dice.choice([0.0, 0.7, 1.0])),
    )


def adversarial_problem(seed: int) -> Problem:
    """Return a problem with several things wrong at once. The same seed gives the same one."""
    dice = np.random.default_rng(seed)
    robots, targets, horizon = (
        int(dice.integers(0, 6)),
        int(dice.integers(0, 7)),
        int(dice.choice([1, 1, 2, 3, 5, 10])),
    )
    side = float(dice.choice([0.0, 0.5, 3.0, 50.0]))
    spots = dice.uniform(-side, side, size=(4, 2))
    # Whatever stands somewhere stands on one of a few spots, so that everything meets.
    positions = spots[dice.integers(0, 4, robots)]
    means = np.tile(spots[dice.integers(0, 4, targets)], (horizon, 1, 1))
    loose = dice.random() < 0.5
    positions = positions + loose * dice.normal(size=positions.shape) * 0.1
    means = means + (dice.random() < 0.5) * dice.normal(size=means.shape)
    limit = dice.choice([0.0, 0.5, 3.0, 20.0]) * np.ones((robots, 2))
    growth = np.abs(dice.choice([0.0, 0.01, 100.0])) * np.ones((horizon, targets, 1, 1)) * np.eye(2)
    half = float(dice.choice([0.3, 1.0, 5.0, 100.0]))
    warm = dice.normal(size=(robots, horizon, 2)) * dice.choice([0.1, 1.0, 100.0])
    low = dice.random() < 0.3
    return Problem(
        robot_ids=tuple(range(robots)),
        step_s=float(dice.choice([0.02, 0.1, 0.5, 1.0])),
        horizon=horizon,
        dynamics=Dynamics.DOUBLE_INTEGRATOR if dice.random() < 0.5 else Dynamics.SINGLE_INTEGRATOR,
        positions=frozen(positions),
        velocities=frozen(dice.normal(size=(robots, 2)) * dice.choice([0.0, 0.3, 5.0])),
        control_lower=frozen(-limit),
        control_upper=frozen(limit),
        speed_limit=frozen(dice.choice([0.0, 0.5, 10.0]) * np.ones(robots)),
        field_lower=frozen([-half, -half]),
        field_upper=frozen([half, half]),
        sees=frozen_bool(dice.random((robots, targets)) < dice.choice([0.0, 0.5, 1.0])),
        target_means=frozen(means),
        target_priors=frozen(_covariances(dice, targets)),
        target_growth=frozen(growth),
        sensor=SensorModel(*dice.choice([0.0, 0.2, 15.0, 1000.0], 4)),
        sensing=_zones(dice, int(dice.integers(0, 4)), robots, spots, 10.0),
        communication=_zones(dice, int(dice.integers(0, 4)), robots, spots, 10.0),
        weights=Weights(1.0, 0.0, 1.0, 1.0) if low else Weights(100.0, 1.0, 1000.0, 1000.0),
        separation_weight=float(dice.choice([0.0, 1000.0])),
        min_dist_m=float(dice.choice([0.0, 0.4, 5.0])),
        obstacles=frozen(spots[dice.integers(0, 4, int(dice.integers(0, 3)))]),
        previous=None if dice.random() < 0.3 else frozen(warm),
        replan=frozen_bool(dice.random(robots) < 0.3),
    )


def faults(problem: Problem, solution: Solution) -> list[str]:
    """Return what is wrong with an answer, in words; an empty list for a sound one."""
    lower, upper = control_box(problem)
    found = []
    arrays = (solution.controls, solution.positions, solution.velocities)
    if not all(np.isfinite(array).all() for array in arrays):
        found.append("not finite")
    if not ((solution.controls >= lower) & (solution.controls <= upper)).all():
        found.append("outside the box")
    start = np.zeros_like(lower) if problem.previous is None else problem.previous
    with np.errstate(all="ignore"):  # slopes of zones without extent, which nobody asks for
        before = cost(problem, np.clip(start, lower, upper))
        at = cost(problem, solution.controls)
    # The clamped priors may have a condition of 1e10, which leaves five digits.
    if not solution.objective <= before + 1e-5 * abs(before) + 1e-12:
        found.append(f"worse than the start: {solution.objective} > {before}")
    if not abs(solution.objective - at) <= 1e-5 * abs(at) + 1e-12:
        found.append(f"claims {solution.objective}, costs {at}")
    return found


@dataclass(frozen=True, slots=True)
class Tally:
    """What came out."""

    solved: int
    faulty: int
    late: int
    latest_s: float


def trial(engine: Engine, count: int, seed: int) -> Tally:
    """Solve `count` problems twice each, to the end and against the clock; report faults."""
    faulty = late = 0
    latest = 0.0
    engine.solve(adversarial_problem(seed), Budget())
    for number in range(seed, seed + count):
        problem = adversarial_problem(number)
        wrong = faults(problem, engine.solve(problem, Budget()))
        hasty, spent = _hasty(engine, problem)
        wrong += faults(problem, hasty)
        if spent > _DEADLINE_S + _LATE_S:
            again = [_hasty(engine, problem)[1] for _ in range(_AGAIN)]
            sys.stdout.write(
                f"problem {number}: took {1e3 * spent:.1f} ms, solved again "
                f"{', '.join(f'{1e3 * each:.1f}' for each in again)} ms\n"
            )
            spent = min(spent, *again)
        late += spent > _DEADLINE_S + _LATE_S
        latest = max(latest, spent)
        faulty += bool(wrong)
        for words in wrong:
            sys.stdout.write(f"problem {number}: {words}\n")
    return Tally(count, faulty, late, latest)


def _hasty(engine: Engine, problem: Problem) -> tuple[Solution, float]:
    """Solve against the clock; return the answer and what it took, seconds of thread time."""
    began = time.thread_time()
    solution = engine.solve(problem, Budget(deadline_s=_DEADLINE_S))
    return solution, time.thread_time() - began


def main(arguments: list[str]) -> int:
    """Run the trial from the command line; return 1 when anything was wrong."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.adversarial")
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--engine", default="fast", choices=engines.names())
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    tally = trial(engines.create(options.engine), options.count, options.seed)
    sys.stdout.write(
        f"{2 * tally.solved} solves by {options.engine}: {tally.faulty} faulty, {tally.late} late "
        f"by more than {1e3 * _LATE_S:.0f} ms, the longest {1e3 * tally.latest_s:.2f} ms against a "
        f"deadline of {1e3 * _DEADLINE_S:.0f} ms (thread time)\n"
    )
    return 1 if tally.faulty or tally.late else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
