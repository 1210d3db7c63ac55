"""Every rung of the ladder."""

import logging
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from solver.arrays import FloatArray, frozen, frozen_bool
from solver.bounds import control_box, rollout
from solver.engines.sqp import SqpEngine
from solver.objective import cost
from solver.planner import Planner
from solver.problem import Budget, Dynamics, EngineFailed, Problem, Rung, Solution
from solver.repair import FAR_M, repaired
from tests.solver.answers import check
from tests.solver.problems import DYNAMICS, random_problem

BUDGET = Budget(iterations=60)
SQP = Planner(SqpEngine())


class Scripted:
    """An engine that does as told."""

    name = "scripted"

    def __init__(self, outcome: Exception | float) -> None:
        self.outcome = outcome
        self.seen: list[tuple[Problem, Budget]] = []

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        self.seen.append((problem, budget))
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


class Bent(Scripted):
    """An engine whose answer to anything has some wrong fields."""

    def __init__(self, **wrong: Any) -> None:
        super().__init__(0.1)
        self.wrong = wrong

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        return replace(super().solve(problem, budget), **self.wrong)


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
    assert "engine scripted" in caplog.messages[0]
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


def test_braking_is_as_hard_as_the_limits_allow_and_no_longer_than_it_takes() -> None:
    problem = replace(
        random_problem(1, 2, 0, 0, 4, Dynamics.DOUBLE_INTEGRATOR, obstacles=0, room=8.0),
        positions=frozen([[0.0, 0.0], [4.0, 0.0]]),
        velocities=frozen([[0.4, -0.4], [0.1, 0.6]]),
    )
    engine = Scripted(EngineFailed("no"))
    found = Planner(engine).solve(problem, BUDGET)
    expected = [
        [[-0.5, 0.5], [-0.3, 0.3], [0.0, 0.0], [0.0, 0.0]],
        [[-0.2, -0.5], [0.0, -0.5], [0.0, -0.2], [0.0, 0.0]],
    ]
    np.testing.assert_allclose(found.controls, expected, atol=1e-12)
    positions, velocities = rollout(problem, found.controls)
    np.testing.assert_array_equal(found.positions, positions)
    np.testing.assert_array_equal(found.velocities, velocities)
    assert (found.iterations, found.engine) == (0, "scripted")
    assert found.solve_s >= 0.0
    ((asked, budget),) = engine.seen
    assert asked is problem
    assert budget is BUDGET


@pytest.mark.parametrize("answer", [float("nan"), float("inf")])
def test_an_answer_that_is_no_number_is_no_answer(
    answer: float, caplog: pytest.LogCaptureFixture
) -> None:
    problem = open_field(previous=frozen(np.full((2, 3, 2), 0.1)))
    found = Planner(Scripted(answer)).solve(problem, BUDGET)
    assert found.rung is Rung.SHIFTED
    assert caplog.messages == ["engine scripted answered with no numbers"]
    check(problem, found)


@pytest.mark.parametrize(
    "wrong",
    [
        {"controls": np.zeros((2, 2, 2))},
        {"controls": np.zeros((1, 3, 2))},
        {"positions": np.full((2, 3, 2), np.nan)},
        {"velocities": np.full((2, 3, 2), np.inf)},
        {"objective": float("nan")},
        {"objective": float("inf")},
    ],
)
def test_an_answer_with_a_hole_in_it_is_no_answer(wrong: dict[str, Any]) -> None:
    problem = open_field(previous=frozen(np.full((2, 3, 2), 0.2)))
    found = Planner(Bent(**wrong)).solve(problem, BUDGET)
    assert found.rung is Rung.SHIFTED
    np.testing.assert_array_equal(found.controls, problem.previous)


def test_a_last_plan_beyond_the_limits_is_cut() -> None:
    problem = open_field(previous=frozen(np.full((2, 3, 2), -3.0)))
    found = Planner(Scripted(EngineFailed("no"))).solve(problem, BUDGET)
    assert found.rung is Rung.SHIFTED
    np.testing.assert_array_equal(found.controls, np.clip(-3.0, *control_box(problem)))


def test_an_answer_beyond_the_limits_is_cut() -> None:
    problem = open_field()
    found = Planner(Scripted(7.0)).solve(problem, BUDGET)
    lower, upper = control_box(problem)
    np.testing.assert_array_equal(found.controls, np.clip(7.0, lower, upper))
    assert found.objective == pytest.approx(cost(problem, found.controls))
    assert found.rung is Rung.FEASIBLE
    assert (found.iterations, found.solve_s, found.engine) == (3, 0.0, "scripted")
    assert found.robot_ids == problem.robot_ids
    for array in (found.controls, found.positions, found.velocities):
        assert not array.flags.writeable


def test_an_answer_that_may_be_flown_is_handed_on_as_it_is() -> None:
    problem = open_field(positions=frozen([[-5.0, 0.0], [5.0, 0.0]]))
    engine = Bent(objective=12.0, iterations=7, solve_s=0.25, late=True)
    found = Planner(engine).solve(problem, BUDGET)
    assert (found.objective, found.iterations, found.solve_s) == (12.0, 7, 0.25)
    assert found.late


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


@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_a_team_that_cannot_be_planned_for_is_where_it_is(dynamics: Dynamics) -> None:
    problem = random_problem(1, 2, 1, 0, 2, dynamics, obstacles=0)
    places = frozen([[np.nan, 2.0], [3.0, np.inf]])
    found = SQP.solve(replace(problem, positions=places), BUDGET)
    np.testing.assert_array_equal(found.positions[0], [[0.0, 2.0]] * 2)
    np.testing.assert_array_equal(found.positions[1], [[3.0, 1e6]] * 2)
    np.testing.assert_array_equal(found.velocities, 0.0)
    assert (found.objective, found.iterations, found.engine) == (0.0, 0, "sqp")
    assert found.solve_s >= 0.0
    if dynamics is Dynamics.DOUBLE_INTEGRATOR:
        wanted = np.clip(-problem.velocities / problem.step_s, -0.5, 0.5)
        np.testing.assert_allclose(found.controls[:, 0], wanted)


def test_a_double_integrator_without_a_step_is_told_nothing() -> None:
    moving = random_problem(1, 2, 1, 0, 2, Dynamics.DOUBLE_INTEGRATOR, obstacles=0)
    for step_s in (0.0, -1.0, float("inf"), float("nan")):
        found = SQP.solve(replace(moving, step_s=step_s), BUDGET)
        np.testing.assert_array_equal(found.controls, 0.0)
    found = SQP.solve(replace(moving, horizon=0), BUDGET)
    assert found.controls.shape == (2, 1, 2)
    assert np.abs(found.controls).max() > 0.0, "it can brake all the same"


def test_who_can_be_planned_for_is_where_its_plan_leads() -> None:
    problem = open_field(3)
    positions = problem.positions.copy()
    positions[1, 0] = np.nan
    found = SQP.solve(replace(problem, positions=frozen(positions)), BUDGET)
    step = problem.step_s * found.controls.cumsum(axis=1)
    for row in (0, 2):
        np.testing.assert_allclose(found.positions[row], problem.positions[row] + step[row])
        np.testing.assert_array_equal(found.velocities[row], found.controls[row])
    np.testing.assert_array_equal(found.positions[1], [[0.0, positions[1, 1]]] * 3)
    assert not found.controls.flags.writeable


def test_a_sound_problem_is_not_touched() -> None:
    problem = open_field()
    assert repaired(problem) is problem


def test_same_problem_same_commands() -> None:
    problem = random_problem(9, 3, 4, 2, 3, room=4.0)
    first, again = (Planner(SqpEngine()).solve(problem, BUDGET) for _ in range(2))
    np.testing.assert_array_equal(first.controls, again.controls)
    np.testing.assert_array_equal(first.positions, again.positions)
    assert first.objective == again.objective
