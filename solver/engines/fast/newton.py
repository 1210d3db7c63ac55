"""Projected Newton on one robot's own problem (Bertsekas 1982, two-metric projection)."""

from solver.arrays import FloatArray
from solver.engines.fast.clock import now
from solver.engines.fast.factors import (
    cholesky,
    factor_indefinite,
    solve_absolute,
    substitute,
)
from solver.engines.fast.jit import kernel, merged
from solver.engines.fast.layout import Team
from solver.engines.fast.robot import cost, expand

TOLERANCE = 1e-7
"""A predicted decrease below this part of the robot's cost ends its iterations."""

_OPTIMISM = 4.0
"""How many times the decrease predicted by one Newton step may still be ahead."""

_ARMIJO = 1e-4
_TRIALS = 4
"""Halvings of a step; beyond them the direction is bent towards the gradient instead.

A hinge that is just off shows no curvature and lets a step be far too long in its direction
alone: shortening the whole step would stop all the others with it.
"""

_LEAST_DAMPING = 1e-3
"""First damping, relative to the largest curvature. It grows and shrinks by tens."""

_DAMPINGS = 8
_GIVEN_UP = 1e-10
"""A damped step that promises less than this part of the cost ends the iterations."""


@kernel
def _find_free(team: Team, i: int, u: FloatArray) -> int:
    """List the controls that are not held at a bound by their gradient."""
    robot, work = team.robots[i], team.work[0]
    count = 0
    for at in range(2 * team.setting[0].steps):
        slope = work.gradient[at]
        work.direction[at] = 0.0
        if (slope > 0.0 and u[at] > robot.lower[at]) or (slope < 0.0 and u[at] < robot.upper[at]):
            work.free[count] = at
            count += 1
    return count


@kernel
def _largest(team: Team, count: int) -> float:
    """Return the largest curvature along a free control."""
    work = team.work[0]
    largest = 0.0
    for row in range(count):
        largest = max(largest, abs(work.bend[work.free[row], work.free[row]]))
    return largest


@kernel
def _aim(team: Team, count: int, damping: float) -> float:
    """Fill the direction -|H + damping|^-1 g over the free controls.

    Returns the decrease predicted.
    """
    work = team.work[0]
    factor, vector, free, bend = work.factor, work.vector, work.free, work.bend
    for row in range(count):
        vector[row] = -work.gradient[free[row]]
        for column in range(row + 1):
            factor[row, column] = bend[free[row], free[column]]
        factor[row, row] += damping
    if cholesky(factor, count):
        substitute(factor, count, vector)
    else:
        for row in range(count):
            for column in range(row + 1):
                factor[row, column] = factor[column, row] = bend[free[row], free[column]]
            factor[row, row] += damping
        factor_indefinite(factor, count, work.order, work.pairs)
        solve_absolute(factor, count, work.order, work.pairs, vector, work.values)
    predicted = 0.0
    for row in range(count):
        work.direction[free[row]] = vector[row]
        predicted -= 0.5 * vector[row] * work.gradient[free[row]]
    return predicted


@merged
def _search(team: Team, i: int, rows: int, u: FloatArray, start: float) -> float:
    """Move u along the projected arc until the cost has decreased enough; return the cost.

    u stays as it was, and `start` is returned, where no step decreases it.
    """
    robot, work = team.robots[i], team.work[0]
    size = 2 * team.setting[0].steps
    length = 1.0
    for _ in range(_TRIALS):
        slope = 0.0
        for at in range(size):
            value = u[at] + length * work.direction[at]
            work.trial[at] = min(max(value, robot.lower[at]), robot.upper[at])
            slope += work.gradient[at] * (u[at] - work.trial[at])
        reached = cost(team, i, rows, work.trial)
        if reached < start - _ARMIJO * max(slope, 0.0):
            for at in range(size):
                u[at] = work.trial[at]
            return reached
        length *= 0.5
    return start


@merged
def descend(
    team: Team, i: int, rows: int, u: FloatArray, most: int, goal: float, deadline: float
) -> tuple[float, float, int, bool]:
    """Improve u (2H,) by at most `most` Newton steps, while the cost may still end below `goal`.

    Returns the cost before and after, the steps taken, and whether it has converged.
    """
    value = before = expand(team, i, rows, u)
    damping = 0.0
    for step in range(most):
        count = _find_free(team, i, u)
        reached = value
        for _ in range(_DAMPINGS):
            predicted = _aim(team, count, damping) if count > 0 else 0.0
            if not predicted > (TOLERANCE if damping == 0.0 else _GIVEN_UP) * value:
                return before, value, step, True
            if value - _OPTIMISM * predicted > goal and damping == 0.0:
                return before, value, step, False
            reached = _search(team, i, rows, u, value)
            if reached < value:
                break
            damping = max(10.0 * damping, _LEAST_DAMPING * _largest(team, count))
        if not reached < value:
            return before, value, step, True
        value = reached
        if step + 1 == most or now(team.work[0].timespec) > deadline:
            return before, value, step + 1, False
        damping = 0.1 * damping if damping > _LEAST_DAMPING * _largest(team, count) else 0.0
        value = expand(team, i, rows, u)
    return before, value, most, False
