"""The box of controls, and the motion they cause.

The box of the first control is hard and holds everything at once: the limits of the control,
the field at the first position and (double integrator) the speed limit at the first velocity.
"""

import numpy as np

from solver.arrays import FloatArray
from solver.problem import Dynamics, Problem


def control_box(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper bounds of the controls, each (M, H, 2).

    Where the limits leave nothing (a robot outside the field, or too fast) both bounds are
    the allowed control that comes nearest: the greatest motion back.
    """
    horizon = problem.horizon
    lower = np.repeat(problem.control_lower[:, None], horizon, axis=1)
    upper = np.repeat(problem.control_upper[:, None], horizon, axis=1)
    h, x = problem.step_s, problem.positions
    low, high = problem.control_lower, problem.control_upper
    if problem.dynamics is Dynamics.DOUBLE_INTEGRATOR:
        v, limit = problem.velocities, problem.speed_limit[:, None]
        low, high = _narrowed(low, high, (-limit - v) / h, (limit - v) / h)
        x, h = x + h * v, 0.5 * h * h
    low, high = _narrowed(low, high, (problem.field_lower - x) / h, (problem.field_upper - x) / h)
    lower[:, 0], upper[:, 0] = low, high
    return lower, upper


def _narrowed(
    low: FloatArray, high: FloatArray, new_low: FloatArray, new_high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return [low, high] cut with a second interval, or its end nearest to that."""
    return (
        np.minimum(np.maximum(new_low, low), high),
        np.maximum(np.minimum(new_high, high), low),
    )


def rollout(problem: Problem, controls: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where the controls (M, H, 2) lead.

    Returns:
        Positions (M, H, 2) at steps 1..H, and velocities (M, H, 2): over each step (single
        integrator) or at its end (double integrator).
    """
    h, x = problem.step_s, problem.positions[:, None]
    if problem.dynamics is Dynamics.SINGLE_INTEGRATOR:
        return x + h * controls.cumsum(axis=1), controls
    v = problem.velocities[:, None]
    after = v + h * controls.cumsum(axis=1)
    before = np.concatenate((v, after[:, :-1]), axis=1)
    return x + (h * before + 0.5 * h * h * controls).cumsum(axis=1), after


def pulled_back(
    problem: Problem, by_position: FloatArray, by_velocity: FloatArray | None
) -> FloatArray:
    """Return the gradient by the controls from those by positions and velocities.

    The adjoint of `rollout`; all arrays (M, H, 2).
    """
    h = problem.step_s
    onward = _summed_back(by_position)
    if problem.dynamics is Dynamics.SINGLE_INTEGRATOR:
        result = h * onward
        return result if by_velocity is None else result + by_velocity
    # dx_k/du_t = h^2 (k - t + 1/2) for t <= k.
    result = h * h * (_summed_back(onward) - 0.5 * onward)
    return result if by_velocity is None else result + h * _summed_back(by_velocity)


def _summed_back(values: FloatArray) -> FloatArray:
    """Return the sums over each step and all later ones."""
    return values[:, ::-1].cumsum(axis=1)[:, ::-1]
