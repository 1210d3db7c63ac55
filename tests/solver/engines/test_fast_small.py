"""The fast engine on small problems, against IPOPT and against what it must never do.

Small enough for plain Python, as which the kernels are when their tests are tested
(`make mutants`).
"""

from dataclasses import replace
from time import thread_time

import numpy as np
import pytest

from solver import objective
from solver.arrays import FloatArray, frozen, frozen_bool
from solver.bounds import control_box, rollout
from solver.engines.fast import FastEngine
from solver.engines.fast.layout import MAX_STEPS
from solver.engines.ipopt import IpoptEngine
from solver.problem import Budget, Dynamics, Problem, Rung
from solver.zones import Zone, ZoneKind
from tests.solver.problems import DYNAMICS, random_problem, zone_table

FAST, IPOPT = FastEngine(), IpoptEngine()
PATIENT = Budget(iterations=500)
SHAPES = [(1, 1, 1), (1, 2, 1), (2, 2, 1), (3, 3, 1), (1, 2, 2), (2, 2, 2), (1, 1, 4), (2, 1, 3)]
"""Robots, targets, steps."""

# Where no machine code is in the cache yet, the first test compiles it.
pytestmark = pytest.mark.timeout(900)


@pytest.mark.parametrize("dynamics", DYNAMICS)
@pytest.mark.parametrize("shape", SHAPES)
def test_no_start_of_ipopt_leads_lower(shape: tuple[int, int, int], dynamics: Dynamics) -> None:
    robots, targets, horizon = shape
    for seed in range(3):
        problem = random_problem(seed, robots, targets, 2, horizon, dynamics, room=3.0)
        best = IPOPT.best_of_starts(problem, 5, seed).objective
        assert FAST.solve(problem, PATIENT).objective <= best * (1.0 + 1e-5), seed


@pytest.mark.parametrize("dynamics", DYNAMICS)
@pytest.mark.parametrize("shape", SHAPES)
def test_an_answer_is_what_it_claims_to_be(shape: tuple[int, int, int], dynamics: Dynamics) -> None:
    robots, targets, horizon = shape
    for seed in (10, 11):
        problem = random_problem(seed, robots, targets, 2, horizon, dynamics, room=1.5)
        lower, upper = control_box(problem)
        start = np.random.default_rng(seed).uniform(lower, upper)
        for previous in (None, frozen(start)):
            asked = replace(problem, previous=previous)
            found = FAST.solve(asked, PATIENT)
            assert (found.controls >= lower).all()
            assert (found.controls <= upper).all()
            positions, velocities = rollout(problem, found.controls)
            np.testing.assert_allclose(found.positions, positions, atol=1e-12)
            np.testing.assert_allclose(found.velocities, velocities, atol=1e-12)
            cost = objective.cost(problem, found.controls)
            assert found.objective == pytest.approx(cost, rel=1e-9)
            assert 0 < found.iterations <= PATIENT.iterations
            assert 0.0 <= found.solve_s <= thread_time()
            began = start if previous is not None else np.clip(0.0 * lower, lower, upper)
            assert cost <= objective.cost(problem, began)
            if found.rung is Rung.CONVERGED:
                assert promised(problem, found.controls) < 1e-4


def promised(problem: Problem, controls: FloatArray) -> float:
    """Return what a small projected gradient step promises, relative to the cost."""
    lower, upper = control_box(problem)
    slope = objective.gradient(problem, controls)
    step = np.clip(controls - 1e-3 * slope, lower, upper) - controls
    return float(-(slope * step).sum()) / (1.0 + objective.cost(problem, controls))


@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_the_longest_horizon_is_solved(dynamics: Dynamics) -> None:
    problem = random_problem(0, 1, 1, 0, MAX_STEPS, dynamics, obstacles=0, room=6.0)
    found = FAST.solve(problem, Budget(iterations=3))
    assert found.objective == pytest.approx(objective.cost(problem, found.controls), rel=1e-9)


def test_beyond_the_field_counts_from_the_second_step_on() -> None:
    """The first step is kept inside by the box, where that can be done."""
    problem = random_problem(0, 1, 0, 0, 3, obstacles=0, room=1.0)
    outside = replace(problem, positions=frozen([[1.5, 0.0]]))
    found = FAST.solve(outside, PATIENT)
    assert found.objective == pytest.approx(objective.cost(outside, found.controls), rel=1e-9)
    assert found.controls[0, 0, 0] == -0.5
    assert found.positions[0, 1, 0] == pytest.approx(1.2, abs=0.06)


@pytest.mark.parametrize("most", [1, 3, 10])
@pytest.mark.parametrize("shape", [(2, 2, 1), (2, 2, 2)])
def test_no_robot_takes_more_steps_than_it_may(shape: tuple[int, int, int], most: int) -> None:
    robots, targets, horizon = shape
    for seed in range(4):
        problem = random_problem(seed, robots, targets, 2, horizon, room=1.0)
        found = FAST.solve(problem, Budget(iterations=most))
        assert found.iterations <= most
        assert np.isfinite(found.controls).all()


def test_the_last_plan_is_kept_where_it_is_as_good_as_any() -> None:
    for seed in range(4):
        problem = random_problem(seed, 2, 2, 1, 2, room=2.0)
        first = FAST.solve(problem, PATIENT)
        again = FAST.solve(replace(problem, previous=first.controls), PATIENT)
        np.testing.assert_allclose(again.controls, first.controls, atol=1e-3)
        assert again.objective <= first.objective * (1.0 + 1e-9)


def test_nobody_and_nothing_to_see_at_rest() -> None:
    alone = random_problem(0, 2, 0, 0, 2, obstacles=0, room=9.0)
    apart = replace(alone, positions=frozen([[-5.0, 0.0], [5.0, 0.0]]))
    found = FAST.solve(apart, PATIENT)
    np.testing.assert_allclose(found.controls, 0.0, atol=1e-9)
    assert found.rung is Rung.CONVERGED


@pytest.mark.parametrize("horizon", [1, 2])
def test_a_zone_between_robot_and_target_is_not_entered_by_who_knows_it(horizon: int) -> None:
    zone = Zone("s1", ZoneKind.SENSING, (1.0, 0.0), ((0.1, 0.0), (0.0, 0.1)), 0.1, 0.05)
    radius = zone.margin + zone.quantile() * np.sqrt(0.1)
    ends = []
    for known in (True, False):
        problem = replace(
            random_problem(0, 1, 1, 0, horizon, obstacles=0, room=9.0),
            positions=frozen([[0.3, 0.0]]),
            sees=frozen_bool([[True]]),
            target_means=frozen(np.tile([1.0, 0.0], (horizon, 1, 1))),
            sensing=zone_table([zone], np.array([[known]])),
        )
        found = FAST.solve(problem, PATIENT)
        ends.append(float(np.linalg.norm(found.positions[0, -1] - zone.mean)))
    assert ends[0] > 0.9 * radius
    assert ends[1] < 0.8 * radius


@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_two_on_a_collision_course_part(dynamics: Dynamics) -> None:
    problem = random_problem(3, 2, 2, 0, 3, dynamics, obstacles=0, room=9.0)
    problem = replace(
        problem,
        positions=frozen([[-0.3, 0.02], [0.3, -0.02]]),
        velocities=frozen([[0.3, 0.0], [-0.3, 0.0]]),
        sees=frozen_bool(np.eye(2)),
        target_means=frozen(np.tile([[1.5, 0.0], [-1.5, 0.0]], (3, 1, 1))),
    )
    found = FAST.solve(problem, PATIENT)
    gaps = np.linalg.norm(found.positions[0] - found.positions[1], axis=1)
    # Soft: what is left of the wish shows in the third digit.
    assert gaps.min() > 0.9 * problem.min_dist_m
