"""IPOPT on the slack form: what an answer holds, and the family of starts."""

from dataclasses import replace

import numpy as np
import pytest

from solver import objective
from solver.arrays import FloatArray, frozen
from solver.bounds import control_box, rollout
from solver.engines.ipopt import IpoptEngine
from solver.problem import Budget, Dynamics, EngineFailed, Problem, Rung, Solution
from tests.solver.problems import DYNAMICS, random_problem

IPOPT = IpoptEngine()
PATIENT = Budget(iterations=500)


def small(seed: int = 0, dynamics: Dynamics = Dynamics.SINGLE_INTEGRATOR) -> Problem:
    return random_problem(seed, 3, 3, 2, 2, dynamics, room=3.0)


@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_an_answer_is_what_it_claims_to_be(dynamics: Dynamics) -> None:
    problem = small(1, dynamics)
    found = IPOPT.solve(problem, PATIENT)
    assert (found.engine, found.robot_ids) == ("ipopt", problem.robot_ids)
    assert found.rung is Rung.CONVERGED
    assert 0 < found.iterations < 500
    assert found.solve_s > 0.0
    assert found.controls.shape == (3, 2, 2)
    lower, upper = control_box(problem)
    assert ((found.controls >= lower) & (found.controls <= upper)).all()
    positions, velocities = rollout(problem, found.controls)
    np.testing.assert_array_equal(found.positions, positions)
    np.testing.assert_array_equal(found.velocities, velocities)
    assert found.objective == objective.cost(problem, found.controls)


@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_an_answer_is_stationary_on_the_box_and_some_controls_are_at_its_rim(
    dynamics: Dynamics,
) -> None:
    at_lower = at_upper = 0
    for seed in range(6):
        problem = small(seed, dynamics)
        found = IPOPT.solve(problem, PATIENT)
        lower, upper = control_box(problem)
        slope = objective.gradient(problem, found.controls)
        step = np.clip(found.controls - 1e-3 * slope, lower, upper) - found.controls
        assert float(np.abs(slope * step).sum()) < 1e-6 * (1.0 + found.objective)
        at_lower += int((found.controls < lower + 1e-4).sum())
        at_upper += int((found.controls > upper - 1e-4).sum())
    assert min(at_lower, at_upper) > 0


def test_a_short_budget_ends_in_a_feasible_answer() -> None:
    found = IPOPT.solve(small(), Budget(iterations=2))
    assert found.rung is Rung.FEASIBLE
    assert found.iterations == 2
    hasty = IPOPT.solve(small(), Budget(iterations=500, deadline_s=1e-9))
    assert hasty.rung is Rung.FEASIBLE
    assert hasty.iterations < IPOPT.solve(small(), PATIENT).iterations


def test_it_starts_from_the_last_plan_or_from_rest() -> None:
    problem = small()
    plan = np.random.default_rng(0).uniform(*control_box(problem))
    for previous, start in ((None, np.zeros_like(plan)), (frozen(plan), plan)):
        asked = replace(problem, previous=previous)
        found = IPOPT.solve(asked, Budget(iterations=3))
        expected = IPOPT.solve_from(asked, Budget(iterations=3), start)
        np.testing.assert_array_equal(found.controls, expected.controls)


def test_there_are_as_many_starts_as_asked_for_the_last_plan_and_rest_first() -> None:
    problem = small()
    plan = np.random.default_rng(0).uniform(*control_box(problem))
    for previous, firsts in ((None, [0.0 * plan]), (frozen(plan), [plan, 0.0 * plan])):
        asked = replace(problem, previous=previous)
        found = IPOPT.every_start(asked, 4, seed=3)
        assert len(found) == 4
        for solution, start in zip(found, firsts, strict=False):
            expected = IPOPT.solve_from(asked, PATIENT, start)
            np.testing.assert_array_equal(solution.controls, expected.controls)
    assert len(IPOPT.every_start(replace(problem, previous=frozen(plan)), 1)) == 1


def test_random_starts_keep_one_direction_anywhere_in_the_box() -> None:
    class Noted(IpoptEngine):
        """Takes note of the starts and fails at every one."""

        def __init__(self) -> None:
            super().__init__()
            self.starts: list[FloatArray] = []

        def solve_from(self, problem: Problem, budget: Budget, start: FloatArray) -> Solution:
            self.starts.append(start)
            raise EngineFailed("noted")

    problem = small()
    engine, again, other = Noted(), Noted(), Noted()
    for each, seed in ((engine, 5), (again, 5), (other, 6)):
        with pytest.raises(ExceptionGroup, match="no start led anywhere") as raised:
            each.every_start(problem, 40, seed)
        assert len(raised.value.exceptions) == 40
    starts = np.stack(engine.starts)
    np.testing.assert_array_equal(starts[0], 0.0)
    np.testing.assert_array_equal(starts, np.stack(again.starts))
    assert not np.array_equal(starts, np.stack(other.starts))
    lower, upper = control_box(problem)
    share = (starts[1:] - lower) / (upper - lower)
    np.testing.assert_allclose(share[:, :, 0], share[:, :, 1])
    assert share[:, :, 0].std(axis=(1, 2)).min() > 0.0, "everybody goes its own way"
    assert share.min() < 0.1 < 0.9 < share.max()
    assert 0.0 <= share.min() <= share.max() <= 1.0


def test_the_best_start_counts_and_all_of_them_are_paid_for() -> None:
    problem = small(2)
    every = IPOPT.every_start(problem, 4, seed=1)
    best = IPOPT.best_of_starts(problem, 4, seed=1)
    assert best.objective == min(solution.objective for solution in every)
    assert best.iterations == sum(solution.iterations for solution in every)


def test_numbers_that_are_none_fail_at_every_start() -> None:
    broken = replace(small(), positions=frozen(np.full((3, 2), np.nan)))
    with pytest.raises(EngineFailed, match="IPOPT"):
        IPOPT.solve(broken, PATIENT)
    with pytest.raises(ExceptionGroup) as raised:
        IPOPT.best_of_starts(broken, 3)
    assert len(raised.value.exceptions) == 3
