"""Projected Newton on one robot's own problem (Bertsekas 1982, two-metric projection)."""

from solver.arrays import FloatArray
from solver.engines.fast.clock import now
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Motion, Scratch, Team
from solver.engines.fast.robot import cost, expand
from solver.engines.fast.spectrum import cholesky, solve_absolute, substitute

TOLERANCE = 1e-7
"""A predicted decrease below this part of the robot's cost ends its iterations."""

_ARMIJO = 1e-4
_HALVINGS = 14


@kernel
def _find_free(motion: Motion, i: int, u: FloatArray, scratch: Scratch) -> int:
    """List the controls that are not held at a bound by their gradient."""
    count = 0
    for at in range(u.shape[0]):
        slope = scratch.gradient[at]
        if (slope > 0.0 and u[at] <= motion.lower[i, at]) or (
            slope < 0.0 and u[at] >= motion.upper[i, at]
        ):
            scratch.direction[at] = 0.0
            continue
        scratch.free[count] = at
        count += 1
    return count


@kernel
def _aim(scratch: Scratch, count: int) -> float:
    """Fill the direction -|H|^-1 g over the free controls, return the predicted decrease."""
    factor, vector, free, bend = scratch.factor, scratch.vector, scratch.free, scratch.bend
    for row in range(count):
        vector[row] = -scratch.gradient[free[row]]
        for column in range(row + 1):
            factor[row, column] = bend[free[row], free[column]]
    if cholesky(factor, count):
        substitute(factor, count, vector)
    else:
        for row in range(count):
            for column in range(row + 1):
                factor[row, column] = factor[column, row] = bend[free[row], free[column]]
        solve_absolute(factor, count, scratch.basis, vector, scratch.work)
    predicted = 0.0
    for row in range(count):
        scratch.direction[free[row]] = vector[row]
        predicted -= 0.5 * vector[row] * scratch.gradient[free[row]]
    return predicted


@kernel
def _search(team: Team, i: int, rows: int, u: FloatArray, start: float) -> float:
    """Move u along the projected arc until the cost has decreased enough; return the cost.

    u stays as it was, and `start` is returned, where no step decreases it.
    """
    motion, trial = team.motion, team.scratch.trial
    direction, gradient = team.scratch.direction, team.scratch.gradient
    length = 1.0
    for _ in range(_HALVINGS):
        slope = 0.0
        for at in range(u.shape[0]):
            value = u[at] + length * direction[at]
            trial[at] = min(max(value, motion.lower[i, at]), motion.upper[i, at])
            slope += gradient[at] * (u[at] - trial[at])
        reached = cost(team, i, rows, trial)
        if reached < start - _ARMIJO * max(slope, 0.0):
            u[:] = trial
            return reached
        length *= 0.5
    return start


@kernel
def descend(
    team: Team, i: int, rows: int, u: FloatArray, most: int, deadline: float
) -> tuple[float, float, int, bool]:
    """Improve u (2H,) by at most `most` Newton steps.

    Returns the cost before and after, the steps taken, and whether it has converged.
    """
    scratch = team.scratch
    value = before = expand(team, i, rows, u)
    for step in range(most):
        count = _find_free(team.motion, i, u, scratch)
        if count == 0:
            return before, value, step, True
        predicted = _aim(scratch, count)
        if not predicted > TOLERANCE * value:
            return before, value, step, True
        reached = _search(team, i, rows, u, value)
        if not reached < value:
            return before, value, step, True
        value = reached
        if step + 1 == most or now(scratch.timespec) > deadline:
            return before, value, step + 1, False
        value = expand(team, i, rows, u)
    return before, value, most, False
