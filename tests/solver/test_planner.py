"""Every rung of the ladder, and inputs nobody should ever send."""

import logging
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import pdist

from solver.arrays import FloatArray, frozen, frozen_bool
from solver.bounds import control_box, rollout
from solver.directives import Weights
from solver.engines.sqp import SqpEngine
from solver.objective import cost
from solver.planner import Planner
from solver.problem import Budget, Dynamics, EngineFailed, Problem, Rung, Solution
from solver.repair import FAR_M, repaired
from tests.solver.problems import DYNAMICS, coincident, random_problem

BUDGET = Budget(iterations=60)
SQP = Planner(SqpEngine())


class Scripted:
    """An engine that does as told."""

    name = "scripted"

    def __init__(self, outcome: Exception | float) -> None:
        self.outcome = outcome
        self.seen: list[Problem] = []

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        self.seen.append(problem)
        if isinstance(self.outcome, Exception):
            raise self.outcome
        controls = np.full((len(problem.robot_ids), problem.horizon, 2), self.outcome)
        positions, velocities = rollout(problem, controls)
        return Solution(
            problem.robot_ids,
            controls,
            positions,
            velocities,
            1.0,
            Rung.FEASIBLE,
            3,
            0.0,
            self.name,
        )


def check(problem: Problem, solution: Solution) -> None:
    """What must hold of every answer, whatever the question."""
    count, horizon = len(problem.robot_ids), max(problem.horizon, 1)
    assert solution.robot_ids == problem.robot_ids
    for array in (solution.controls, solution.positions, solution.velocities):
        assert array.shape == (count, horizon, 2)
        assert np.isfinite(array).all()
    assert np.isfinite(solution.objective)
    bounds = np.stack((problem.control_lower, problem.control_upper))
    bounds[~(np.abs(bounds) <= 1e6)] = 0.0
    low, high = bounds.min(axis=0), bounds.max(axis=0)
    assert (solution.controls >= low[:, None] - 1e-9).all()
    assert (solution.controls <= high[:, None] + 1e-9).all()


def open_field(robots: int = 2, **changes: Any) -> Problem:
    return replace(random_problem(1, robots, 2, 1, 3, obstacles=0, room=8.0), **changes)


def test_converged_is_the_engines_own_answer() -> None:
    problem = random_problem(2, 2, 3, 1, obstacles=0, room=6.0)
    found = SQP.solve(problem, BUDGET)
    direct = SqpEngine().solve(problem, BUDGET)
    assert found.rung is Rung.CONVERGED
    np.testing.assert_array_equal(found.controls, direct.controls)
    check(problem, found)


def test_feasible_when_the_budget_is_short() -> None:
    problem = random_problem(2, 4, 8, 2, 5, Dynamics.DOUBLE_INTEGRATOR, room=4.0)
    found = SQP.solve(problem, Budget(iterations=1))
    assert found.rung is Rung.FEASIBLE
    check(problem, found)


@pytest.mark.parametrize("failure", [EngineFailed("no"), ZeroDivisionError("a fault")])
def test_shifted_when_the_engine_fails(
    failure: Exception, caplog: pytest.LogCaptureFixture
) -> None:
    previous = frozen(np.full((2, 3, 2), 0.2))
    problem = open_field(previous=previous)
    with caplog.at_level(logging.WARNING):
        found = Planner(Scripted(failure)).solve(problem, BUDGET)
    assert found.rung is Rung.SHIFTED
    np.testing.assert_array_equal(found.controls, previous)
    assert found.objective == pytest.approx(cost(problem, previous))
    assert str(failure) in caplog.text
    check(problem, found)


@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_brake_when_there_is_no_plan_either(dynamics: Dynamics) -> None:
    problem = random_problem(1, 2, 2, 1, 3, dynamics, obstacles=0, room=8.0)
    found = Planner(Scripted(EngineFailed("no"))).solve(problem, BUDGET)
    assert found.rung is Rung.BRAKE
    check(problem, found)
    if dynamics is Dynamics.SINGLE_INTEGRATOR:
        np.testing.assert_array_equal(found.controls, 0.0)
    else:
        # 0.4 m/s at 0.5 m/s^2 and 0.5 s: at rest within two steps.
        np.testing.assert_allclose(found.velocities[:, 1:], 0.0, atol=1e-12)


@pytest.mark.parametrize("answer", [float("nan"), float("inf")])
def test_an_answer_that_is_no_number_is_no_answer(answer: float) -> None:
    problem = open_field(previous=frozen(np.full((2, 3, 2), 0.1)))
    found = Planner(Scripted(answer)).solve(problem, BUDGET)
    assert found.rung is Rung.SHIFTED
    check(problem, found)


def test_an_answer_beyond_the_limits_is_cut() -> None:
    problem = open_field()
    found = Planner(Scripted(7.0)).solve(problem, BUDGET)
    lower, upper = control_box(problem)
    np.testing.assert_array_equal(found.controls, np.clip(7.0, lower, upper))
    assert found.objective == pytest.approx(cost(problem, found.controls))
    assert found.rung is Rung.FEASIBLE


def test_the_filter_comes_after_the_engine() -> None:
    problem = open_field(
        positions=frozen([[0.0, 0.0], [0.45, 0.45]]), sees=frozen_bool(np.zeros((2, 2)))
    )
    greedy = Scripted(0.5)
    found = Planner(greedy).solve(
        replace(problem, positions=frozen([[0.0, 0.0], [0.3, 0.28]])), BUDGET
    )
    assert pdist(found.positions[:, 0])[0] >= 0.4 - 1e-9
    assert found.controls[0, 0, 0] < 0.1
    check(problem, found)


def test_an_empty_team_has_nothing_to_do() -> None:
    problem = random_problem(0, robots=0, targets=3, horizon=2)
    found = SQP.solve(problem, BUDGET)
    assert found.controls.shape == (0, 2, 2)
    assert found.rung is Rung.CONVERGED


@pytest.mark.parametrize("dynamics", DYNAMICS)
@pytest.mark.parametrize(
    ("robots", "targets", "zones", "obstacles"),
    [(2, 0, 2, 1), (2, 3, 0, 0), (1, 1, 0, 0), (3, 0, 0, 0), (1, 4, 3, 2)],
)
def test_nothing_to_see_nothing_to_fear_nobody_else(
    robots: int, targets: int, zones: int, obstacles: int, dynamics: Dynamics
) -> None:
    problem = random_problem(3, robots, targets, zones, 2, dynamics, obstacles)
    check(problem, SQP.solve(problem, BUDGET))


def test_all_sensing_failed() -> None:
    problem = open_field()
    blind = replace(problem, sees=frozen_bool(np.zeros_like(problem.sees)))
    found = SQP.solve(blind, BUDGET)
    check(blind, found)
    assert found.rung is Rung.CONVERGED


def test_a_robot_without_a_position_stands_and_the_other_ones_fly_as_if_alone() -> None:
    problem = open_field(3)
    positions = problem.positions.copy()
    positions[1] = np.nan
    found = SQP.solve(replace(problem, positions=frozen(positions)), BUDGET)
    check(problem, found)
    np.testing.assert_array_equal(found.controls[1], 0.0)
    keep = [0, 2]

    def rows(array: FloatArray) -> FloatArray:
        return frozen(array[keep])

    alone = replace(
        problem,
        robot_ids=(problem.robot_ids[0], problem.robot_ids[2]),
        positions=rows(problem.positions),
        velocities=rows(problem.velocities),
        control_lower=rows(problem.control_lower),
        control_upper=rows(problem.control_upper),
        speed_limit=rows(problem.speed_limit),
        sees=frozen_bool(problem.sees[keep]),
        sensing=replace(problem.sensing, known=frozen_bool(problem.sensing.known[keep])),
        communication=replace(
            problem.communication, known=frozen_bool(problem.communication.known[keep])
        ),
        replan=frozen_bool(problem.replan[keep]),
    )
    np.testing.assert_array_equal(found.controls[keep], SQP.solve(alone, BUDGET).controls)


def test_a_last_plan_of_another_team_is_none() -> None:
    problem = open_field(3)
    positions = problem.positions.copy()
    positions[1] = np.nan
    lame = replace(problem, positions=frozen(positions))
    other = replace(lame, previous=frozen(np.ones((2, problem.horizon, 2))))
    expected = SQP.solve(lame, BUDGET).controls
    np.testing.assert_array_equal(SQP.solve(other, BUDGET).controls, expected)


def test_an_endless_distance_to_keep_is_repaired() -> None:
    problem = open_field(min_dist_m=float("inf"))
    assert repaired(problem).min_dist_m == FAR_M
    check(problem, SQP.solve(problem, BUDGET))


def test_bounds_the_wrong_way_round_and_none_at_all() -> None:
    problem = open_field()
    swapped = replace(
        problem, control_lower=problem.control_upper, control_upper=problem.control_lower
    )
    expected = SQP.solve(problem, BUDGET).controls
    np.testing.assert_array_equal(SQP.solve(swapped, BUDGET).controls, expected)
    missing = replace(problem, control_lower=frozen(np.full((2, 2), np.nan)))
    found = SQP.solve(missing, BUDGET)
    check(missing, found)
    assert (found.controls >= 0.0).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"step_s": 0.0},
        {"step_s": float("nan")},
        {"horizon": 0},
        {"positions": frozen(np.full((2, 2), np.nan))},
    ],
)
def test_what_cannot_be_planned_brakes(changes: dict[str, Any]) -> None:
    problem = open_field(**changes)
    found = SQP.solve(problem, BUDGET)
    assert found.rung is Rung.BRAKE
    np.testing.assert_array_equal(found.controls, 0.0)
    check(problem, found)


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


def test_a_sound_problem_is_not_touched() -> None:
    problem = open_field()
    assert repaired(problem) is problem


def test_same_problem_same_commands() -> None:
    problem = random_problem(9, 3, 4, 2, 3, room=4.0)
    first, again = (Planner(SqpEngine()).solve(problem, BUDGET) for _ in range(2))
    np.testing.assert_array_equal(first.controls, again.controls)
    np.testing.assert_array_equal(first.positions, again.positions)
    assert first.objective == again.objective
