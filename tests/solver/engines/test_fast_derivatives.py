"""The kernels' first and second derivatives against independent ones."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import objective
from solver.arrays import FloatArray, frozen, frozen_bool
from solver.bounds import control_box
from solver.engines.casadi_model import padded, parameters, reduced, shape_of
from solver.engines.fast.derivatives import joint_derivatives, local_derivatives
from solver.problem import Dynamics, Problem
from tests.solver.problems import DYNAMICS, coincident, random_problem

# Where no machine code is in the cache yet, the first test compiles it.
pytestmark = pytest.mark.timeout(900)


def interior(seed: int, problem: Problem) -> FloatArray:
    lower, upper = control_box(problem)
    share = np.random.default_rng(seed).uniform(0.05, 0.95, size=lower.shape)
    return np.asarray(lower + share * (upper - lower))


def unjammed(problem: Problem) -> Problem:
    nobody = frozen_bool(np.zeros_like(problem.communication.known))
    return replace(problem, communication=replace(problem.communication, known=nobody))


def differences(problem: Problem, controls: FloatArray, robot: int) -> FloatArray:
    """Hessian block of one robot by central differences of the reference gradient."""
    size = 2 * problem.horizon
    return joint_differences(problem, controls, robot)[size * robot : size * (robot + 1)]


def joint_differences(problem: Problem, controls: FloatArray, robot: int) -> FloatArray:
    """Columns of one robot in the team's Hessian, (2HM, 2H), likewise."""
    size, step = 2 * problem.horizon, 1e-6
    columns = []
    for at in range(size):
        slopes = []
        for sign in (1.0, -1.0):
            moved = controls.copy()
            moved[robot].reshape(-1)[at] += sign * step
            slopes.append(objective.gradient(problem, moved).ravel())
        columns.append((slopes[0] - slopes[1]) / (2.0 * step))
    return np.stack(columns, axis=1)


def compare(problem: Problem, controls: FloatArray, robot: int) -> None:
    searched, value, gradient, hessian = local_derivatives(problem, controls, robot)
    assert searched == pytest.approx(value, rel=1e-12)
    expected = objective.gradient(problem, controls)[robot].ravel()
    np.testing.assert_allclose(gradient, expected, atol=1e-9 * (1.0 + np.abs(expected).max()))
    bend = differences(problem, controls, robot)
    np.testing.assert_allclose(hessian, bend, atol=2e-6 * (1.0 + np.abs(bend).max()))
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12 * (1.0 + np.abs(hessian).max()))


@settings(max_examples=80)
@given(
    seed=st.integers(0, 2**32 - 1),
    robots=st.integers(1, 5),
    targets=st.integers(0, 5),
    zones=st.integers(0, 3),
    horizon=st.integers(1, 10),
    dynamics=st.sampled_from(DYNAMICS),
    room=st.sampled_from([0.4, 1.5, 5.0]),
)
def test_every_term_has_its_exact_gradient_and_hessian(
    seed: int, robots: int, targets: int, zones: int, horizon: int, dynamics: Dynamics, room: float
) -> None:
    """Rooms from crowded (everybody inside zones, on targets, on each other) to wide."""
    problem = random_problem(seed, robots, targets, zones, horizon, dynamics, 2, room)
    compare(problem, interior(seed, problem), seed % robots)


@pytest.mark.parametrize("dynamics", DYNAMICS)
@pytest.mark.parametrize("horizon", [1, 3])
def test_a_glance_at_every_term_of_a_robot_and_of_a_team(horizon: int, dynamics: Dynamics) -> None:
    """The two large comparisons below and above on a few problems, for whoever has no time."""
    for seed in range(3):
        problem = random_problem(seed, 3, 3, 2, horizon, dynamics, 2, (0.4, 1.5, 3.0)[seed])
        at = interior(seed, problem)
        compare(problem, at, seed)
        calm = unjammed(problem)
        searched, _, gradient, hessian = joint_derivatives(calm, at)
        assert searched == pytest.approx(objective.cost(calm, at), rel=1e-9)
        expected = objective.gradient(calm, at).ravel()
        np.testing.assert_allclose(gradient, expected, atol=1e-9 * (1.0 + np.abs(expected).max()))
        bend = np.concatenate([joint_differences(calm, at, robot) for robot in range(3)], 1)
        np.testing.assert_allclose(hessian, bend, atol=2e-6 * (1.0 + np.abs(bend).max()))


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), horizon=st.integers(1, 4))
def test_derivatives_hold_at_coincident_points(seed: int, horizon: int) -> None:
    """All robots on one target on a zone's centre, and resting there."""
    problem = coincident(random_problem(seed, 3, 3, 2, horizon))
    compare(problem, np.zeros((3, horizon, 2)), seed % 3)


def test_a_move_changes_the_own_cost_as_it_changes_the_teams() -> None:
    """A robot's own problem holds every term it moves, jamming rows of its mates included."""
    for seed in range(30):
        dynamics = DYNAMICS[seed % 2]
        problem = random_problem(seed, 5, 6, 3, 1 + seed % 5, dynamics, room=2.0)
        before, after = interior(seed, problem), interior(seed + 1000, problem)
        moved = before.copy()
        moved[2] = after[2]
        own = local_derivatives(problem, moved, 2)[0] - local_derivatives(problem, before, 2)[0]
        team = objective.cost(problem, moved) - objective.cost(problem, before)
        assert own == pytest.approx(team, rel=1e-9, abs=1e-9 * abs(team) + 1e-9)


@pytest.mark.parametrize("dynamics", DYNAMICS)
def test_the_hessian_is_the_symbolic_one(dynamics: Dynamics) -> None:
    problem = random_problem(3, 3, 4, 2, 4, dynamics, room=1.5)
    shape = shape_of(problem)
    controls, vector, total = reduced(shape)
    bend = ca.Function("H", [controls, vector], [ca.hessian(total, controls)[0]])
    for seed in range(5):
        problem = random_problem(seed, 3, 4, 2, 4, dynamics, room=1.5)
        at = interior(seed, problem)
        symbolic = np.asarray(bend(padded(at, shape.robots).ravel(), parameters(problem, shape)))
        for robot in range(3):
            block = slice(8 * robot, 8 * robot + 8)
            hessian = local_derivatives(problem, at, robot)[3]
            scale = 1.0 + np.abs(hessian).max()
            np.testing.assert_allclose(hessian, symbolic[block, block], atol=1e-10 * scale)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    robots=st.integers(2, 4),
    targets=st.integers(0, 4),
    horizon=st.integers(1, 5),
    dynamics=st.sampled_from(DYNAMICS),
    room=st.sampled_from([0.4, 1.5, 5.0]),
)
def test_the_teams_derivatives_are_exact_where_nobody_is_jammed(
    seed: int, robots: int, targets: int, horizon: int, dynamics: Dynamics, room: float
) -> None:
    problem = unjammed(random_problem(seed, robots, targets, 2, horizon, dynamics, 1, room))
    at = interior(seed, problem)
    searched, value, gradient, hessian = joint_derivatives(problem, at)
    assert searched == pytest.approx(objective.cost(problem, at), rel=1e-9)
    assert value == searched
    expected = objective.gradient(problem, at).ravel()
    np.testing.assert_allclose(gradient, expected, atol=1e-9 * (1.0 + np.abs(expected).max()))
    bend = np.concatenate([joint_differences(problem, at, robot) for robot in range(robots)], 1)
    np.testing.assert_allclose(hessian, bend, atol=2e-6 * (1.0 + np.abs(bend).max()))
    np.testing.assert_array_equal(hessian, hessian.T)


def test_jamming_keeps_the_teams_gradient_and_diagonal_blocks_exact() -> None:
    """What is left out of the Hessian is named in `joint.py`: nothing but jamming's mixed terms."""
    for seed in range(10):
        problem = random_problem(seed, 4, 4, 2, 1 + seed % 3, DYNAMICS[seed % 2], room=1.0)
        at = interior(seed, problem)
        gradient, hessian = joint_derivatives(problem, at)[2:]
        expected = objective.gradient(problem, at).ravel()
        np.testing.assert_allclose(gradient, expected, atol=1e-9 * (1.0 + np.abs(expected).max()))
        size = 2 * problem.horizon
        for robot in range(4):
            block = slice(size * robot, size * (robot + 1))
            own = local_derivatives(problem, at, robot)[3]
            scale = 1.0 + np.abs(own).max()
            np.testing.assert_allclose(hessian[block, block], own, atol=1e-12 * scale)


def test_far_robots_and_zones_are_left_out_without_a_trace() -> None:
    """The lists are pruned by reach; the numbers must not notice."""
    problem = random_problem(5, 4, 4, 3, 3, room=3.0)
    spread = frozen(
        problem.positions * np.array([[1.0, 1.0], [40.0, 1.0], [1.0, 40.0], [9.0, 9.0]])
    )
    wide = replace(
        problem,
        positions=spread,
        field_lower=frozen([-200.0, -200.0]),
        field_upper=frozen([200.0, 200.0]),
    )
    for robot in range(4):
        compare(wide, interior(1, wide), robot)
