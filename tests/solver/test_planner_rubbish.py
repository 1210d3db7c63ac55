"""Inputs nobody should ever send: rubbish in, sound commands out."""

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from solver.arrays import FloatArray, frozen
from solver.directives import Weights
from solver.engines.sqp import SqpEngine
from solver.planner import Planner
from solver.problem import Budget, Dynamics, Problem, Rung
from tests.solver.answers import check
from tests.solver.problems import DYNAMICS, coincident, random_problem

BUDGET = Budget(iterations=60)
SQP = Planner(SqpEngine())

NUMERIC = (
    "velocities", "control_lower", "control_upper", "speed_limit", "field_lower", "field_upper",
    "target_means", "target_priors", "target_growth", "obstacles", "positions",
)  # fmt: skip
ZONE_NUMERIC = ("centres", "covariances", "margins", "quantiles", "severities")
RUBBISH = (np.nan, np.inf, -np.inf, 1e300, -1e300, 0.0, -1.0, 1e-300)


def spoiled(problem: Problem, rng: np.random.Generator) -> Problem:
    """Return the problem with some of its numbers replaced by rubbish."""

    def rot(array: FloatArray) -> FloatArray:
        values = array.copy()
        if values.size:
            for _ in range(int(rng.integers(1, 4))):
                values.ravel()[rng.integers(values.size)] = rng.choice(RUBBISH)
        return frozen(values)

    for name in rng.choice(NUMERIC, size=rng.integers(1, 5), replace=False):
        changes: dict[str, Any] = {str(name): rot(getattr(problem, name))}
        problem = replace(problem, **changes)
    for kind in ("sensing", "communication"):
        name = str(rng.choice(ZONE_NUMERIC))
        table = getattr(problem, kind)
        changes = {kind: replace(table, **{name: rot(getattr(table, name))})}
        problem = replace(problem, **changes)
    if rng.random() < 0.3:
        problem = replace(problem, weights=Weights(*rng.choice(RUBBISH, size=4).tolist()))
    if rng.random() < 0.3:
        shape = (len(problem.robot_ids), problem.horizon, 2)
        problem = replace(problem, previous=rot(np.zeros(shape)))
    return problem


@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    robots=st.integers(1, 3),
    horizon=st.integers(1, 2),
    dynamics=st.sampled_from(DYNAMICS),
)
def test_rubbish_in_sound_commands_out(
    seed: int, robots: int, horizon: int, dynamics: Dynamics
) -> None:
    rng = np.random.default_rng(seed)
    problem = spoiled(random_problem(seed, robots, 2, 2, horizon, dynamics), rng)
    check(problem, SQP.solve(problem, Budget(iterations=15)))


@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    dynamics=st.sampled_from(DYNAMICS),
    tracking=st.sampled_from([1e-3, 10.0, 1e3]),
    safety=st.sampled_from([1e-3, 50.0, 1e4]),
    doubt=st.sampled_from([0.0, 1e-12, 1.0, 1e9]),
)
def test_adversarial_but_finite(
    seed: int, dynamics: Dynamics, tracking: float, safety: float, doubt: float
) -> None:
    problem = coincident(random_problem(seed, 3, 3, 2, 1, dynamics))
    problem = replace(
        problem,
        target_priors=frozen(problem.target_priors * doubt),
        weights=Weights(tracking, 0.05, safety, safety),
    )
    found = SQP.solve(problem, BUDGET)
    check(problem, found)
    assert found.rung in (Rung.CONVERGED, Rung.FEASIBLE)
