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
_HALVINGS = 14


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
def _aim(team: Team, count: int) -> float:
    """Fill the direction -|H|^-1 g over the free controls, return the predicted decrease."""
    work = team.work[0]
    factor, vector, free, bend = work.factor, work.vector, work.free, work.bend
    for row in range(count):
        vector[row] = -work.gradient[free[row]]
        for column in range(row + 1):
            factor[row, column] = bend[free[row], free[column]]
    if cholesky(factor, count):
        substitute(factor, count, vector)
    else:
        for row in range(count):
            for column in range(row + 1):
                factor[row, column] = factor[column, row] = bend[free[row], free[column]]
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
    for _ in range(_HALVINGS):
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
    for step in range(most):
        count = _find_free(team, i, u)
        predicted = _aim(team, count) if count > 0 else 0.0
        if not predicted > TOLERANCE * value:
            return before, value, step, True
        if value - _OPTIMISM * predicted > goal:
            return before, value, step, False
        reached = _search(team, i, rows, u, value)
        if not reached < value:
            return before, value, step, True
        value = reached
        if step + 1 == most or now(team.work[0].timespec) > deadline:
            return before, value, step + 1, False
        value = expand(team, i, rows, u)
    return before, value, most, False
