"""The hard box of the first step, and the motion."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from solver.arrays import frozen
from solver.bounds import control_box, pulled_back, rollout
from solver.problem import Dynamics
from tests.solver.problems import DYNAMICS, random_controls, random_problem

seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds, dynamics=st.sampled_from(DYNAMICS))
def test_any_control_of_the_box_keeps_field_and_speed_at_the_first_step(
    seed: int, dynamics: Dynamics
) -> None:
    problem = random_problem(seed, horizon=2, dynamics=dynamics)
    lower, upper = control_box(problem)
    assert (lower <= upper).all()
    assert (lower >= problem.control_lower[:, None]).all()
    assert (upper <= problem.control_upper[:, None]).all()
    np.testing.assert_array_equal(lower[:, 1], problem.control_lower)
    rng = np.random.default_rng(seed)
    controls = lower + rng.random(lower.shape) * (upper - lower)
    positions, velocities = rollout(problem, controls)
    inside = (lower[:, 0] < upper[:, 0]).all(axis=1)
    assert (positions[inside, 0] >= problem.field_lower - 1e-9).all()
    assert (positions[inside, 0] <= problem.field_upper + 1e-9).all()
    if dynamics is Dynamics.DOUBLE_INTEGRATOR:
        assert (np.abs(velocities[inside, 0]) <= 0.6 + 1e-9).all()


def test_a_robot_outside_the_field_may_only_come_back_as_fast_as_it_can() -> None:
    problem = random_problem(0, robots=1, horizon=1)
    problem = replace(problem, positions=frozen([[50.0, 0.0]]))
    lower, upper = control_box(problem)
    np.testing.assert_array_equal(lower[0, 0], [-0.5, -0.5])
    np.testing.assert_array_equal(upper[0, 0], [-0.5, 0.5])


def test_a_double_integrator_above_its_speed_limit_brakes_fully() -> None:
    problem = random_problem(0, robots=1, horizon=1, dynamics=Dynamics.DOUBLE_INTEGRATOR)
    problem = replace(problem, positions=frozen([[0.0, 0.0]]), velocities=frozen([[3.0, 0.0]]))
    lower, upper = control_box(problem)
    np.testing.assert_array_equal(lower[0, 0], [-0.5, -0.5])
    assert upper[0, 0, 0] == -0.5


@settings(max_examples=30)
@given(seed=seeds, horizon=st.integers(1, 6), dynamics=st.sampled_from(DYNAMICS))
def test_pulled_back_is_the_adjoint_of_the_rollout(
    seed: int, horizon: int, dynamics: Dynamics
) -> None:
    problem = random_problem(seed, robots=2, horizon=horizon, dynamics=dynamics)
    rng = np.random.default_rng(seed)
    by_position, by_velocity = rng.normal(size=(2, 2, horizon, 2))
    change = random_controls(seed, problem)
    base = rollout(problem, np.zeros_like(change))
    moved = rollout(problem, change)
    forward = float(((moved[0] - base[0]) * by_position).sum())
    forward += float(((moved[1] - base[1]) * by_velocity).sum())
    backward = float((change * pulled_back(problem, by_position, by_velocity)).sum())
    np.testing.assert_allclose(forward, backward, rtol=1e-9, atol=1e-9)
