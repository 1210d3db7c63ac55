"""Projected Newton (Bertsekas 1982, two-metric projection): one robot's problem or a group's."""

from math import inf

from solver.arrays import FloatArray
from solver.engines.fast.clock import is_past
from solver.engines.fast.factors import (
    cholesky,
    factor_indefinite,
    solve_absolute,
    substitute,
)
from solver.engines.fast.guards import forget_shift, note_shift
from solver.engines.fast.jit import kernel, merged
from solver.engines.fast.joint import expand_joint, joint_cost
from solver.engines.fast.layout import Table, Team
from solver.engines.fast.robot import cost, expand

TOLERANCE = 1e-7
"""A predicted decrease below this part of the robot's cost ends its iterations."""

_OPTIMISM, _JOINT_OPTIMISM = 4.0, 2.0
"""How many times the decrease predicted by one Newton step may still be ahead, of one robot and of
several: the latter step from plans that are good for all but one or two."""

_ARMIJO = 1e-4
_TRIALS = 2
"""Halvings of a step; beyond them the direction is bent towards the gradient instead.

A hinge that is just off shows no curvature and lets a step be far too long in its direction
alone: shortening the whole step would stop all the others with it.
"""

_DAMPED_TRIALS = 1
"""A damped step that is too long is damped more, which turns it as well as shortens it."""

_LEAST_DAMPING = 1e-3
"""First damping, relative to the largest curvature. It grows and shrinks by tens."""

_MEETING = 0.02
"""A fresh start that comes nearer to the plan to be beaten than this part of the box has lost."""

_DAMPINGS = 8
_GIVEN_UP = 1e-10
"""A damped step that promises less than this part of the cost ends the iterations."""


GROUP = -1
"""In place of a robot: the group's controls together (`joint.py`), scratch in team.work[1]."""


@kernel
def own_controls(team: Team, i: int) -> int:
    """Fill the bounds of whoever is at work; return the number of their controls."""
    size: int = 2 * team.setting[0].steps
    if i != GROUP:
        _copy_bounds(team.robots[i], team.work[0], 0, size)
        return size
    joint = team.work[1]
    for place in range(joint.members):
        _copy_bounds(team.robots[joint.group[place]], joint, place * size, size)
    return size * int(joint.members)


@kernel
def _copy_bounds(robot: Table, work: Table, first: int, size: int) -> None:
    for at in range(size):
        work.lower[first + at] = robot.lower[at]
        work.upper[first + at] = robot.upper[at]


@kernel
def _find_free(work: Table, u: FloatArray, size: int) -> int:
    """List the controls that are not held at a bound by their gradient."""
    count = 0
    for at in range(size):
        slope = work.gradient[at]
        work.direction[at] = 0.0
        if (slope > 0.0 and u[at] > work.lower[at]) or (slope < 0.0 and u[at] < work.upper[at]):
            work.free[count] = at
            count += 1
    return count


@kernel
def _largest(work: Table, count: int) -> float:
    """Return the largest curvature along a free control."""
    largest = 0.0
    for row in range(count):
        largest = max(largest, abs(work.bend[work.free[row], work.free[row]]))
    return largest


@kernel
def _aim(work: Table, count: int, damping: float) -> float:
    """Fill the direction -|H + damping|^-1 g over the free controls.

    Returns the decrease predicted.
    """
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
def evaluate(team: Team, i: int, rows: int, u: FloatArray) -> float:
    """Return the cost of whoever is at work."""
    return cost(team, i, rows, u) if i != GROUP else joint_cost(team, u)


@merged
def differentiate(team: Team, i: int, rows: int, u: FloatArray) -> float:
    """Return the same, gradient and Hessian filled."""
    if i != GROUP:
        return expand(team, i, rows, u)
    value = joint_cost(team, u)
    expand_joint(team)
    return value


@merged
def renewed(team: Team, i: int, rows: int, u: FloatArray, value: float) -> float:
    """Return the same at u, the controls evaluated last, which cost `value`."""
    if i != GROUP:
        return expand(team, i, rows, u)
    expand_joint(team)
    return value


@merged
def _search(
    team: Team, i: int, rows: int, u: FloatArray, start: float, size: int, trials: int
) -> float:
    """Move u along the projected arc until the cost has decreased enough; return the cost.

    u stays as it was, and `start` is returned, where no step decreases it.
    """
    work = team.work[1 if i == GROUP else 0]
    length = 1.0
    for _ in range(trials):
        slope = 0.0
        for at in range(size):
            value = u[at] + length * work.direction[at]
            work.trial[at] = min(max(value, work.lower[at]), work.upper[at])
            slope += work.gradient[at] * (u[at] - work.trial[at])
        reached = evaluate(team, i, rows, work.trial)
        if reached < start - _ARMIJO * max(slope, 0.0):
            for at in range(size):
                u[at] = work.trial[at]
            return reached
        length *= 0.5
    return start


@kernel
def meets(work: Table, i: int, u: FloatArray, size: int) -> bool:
    """Return whether u has come so near the plan to be beaten that it would end there."""
    own = size // work.members if i == GROUP else size
    for at in range(size):
        known = work.best[at] if i != GROUP else work.kept[work.group[at // own] * own + at % own]
        if abs(u[at] - known) > _MEETING * (work.upper[at] - work.lower[at]):
            return False
    return True


@kernel
def _guarded(team: Team, i: int, rows: int, u: FloatArray, start: float, size: int) -> float:
    """Search once more with the hinges closed that the failed direction runs into.

    Returns the cost; where nothing came of it, that is `start` and the derivatives are as
    they were.
    """
    work = team.work[1 if i == GROUP else 0]
    own = 2 * team.setting[0].steps
    for first in range(0, size, own):
        note_shift(team, i if i != GROUP else work.group[first // own], work, u, first)
    team.work[0].springs = 0
    differentiate(team, i, rows, u)
    for first in range(0, size, own):
        forget_shift(team, i if i != GROUP else work.group[first // own])
    reached = start
    if team.work[0].springs > 0:
        count = _find_free(work, u, size)
        if count > 0 and _aim(work, count, 0.0) > 0.0:
            reached = _search(team, i, rows, u, start, size, _TRIALS)
        if not reached < start:
            differentiate(team, i, rows, u)
    return reached


@kernel
def descend(
    team: Team, i: int, rows: int, u: FloatArray, most: int, goal: float, deadline: float
) -> tuple[float, float, int, bool]:
    """Improve u (2H,) by at most `most` Newton steps, while the cost may still end below `goal`.

    A finite goal is what the plan in work.best costs, or the team's with those in work.kept.

    For a group u has 2H controls for each, and whatever was tried last stands as the plans.
    Returns the cost before and after, the steps taken, and whether it has converged.
    """
    work = team.work[1 if i == GROUP else 0]
    size = own_controls(team, i)
    optimism = _JOINT_OPTIMISM if i == GROUP else _OPTIMISM
    value = before = differentiate(team, i, rows, u)
    damping = 0.0
    for step in range(most):
        count = _find_free(work, u, size)
        reached, predicted = value, 0.0
        for _ in range(_DAMPINGS):
            predicted = _aim(work, count, damping) if count > 0 else 0.0
            if not predicted > (TOLERANCE if damping == 0.0 else _GIVEN_UP) * value:
                return before, value, step, True
            if value - optimism * predicted > goal and damping == 0.0:
                return before, value, step, False
            trials = _TRIALS if damping == 0.0 else _DAMPED_TRIALS
            reached = _search(team, i, rows, u, value, size, trials)
            if reached < value:
                break
            if damping == 0.0:
                reached = _guarded(team, i, rows, u, value, size)
                if reached < value:
                    break
                count = _find_free(work, u, size)
            damping = max(10.0 * damping, _LEAST_DAMPING * _largest(work, count))
        if not reached < value:
            return before, value, step, True
        promise = value - reached > 0.5 * predicted
        value = reached
        if step + 1 == most or is_past(deadline, team.work[0].timespec):
            return before, value, step + 1, False
        if goal < inf and meets(work, i, u, size):
            return before, value, step + 1, False
        if promise:
            damping = 0.1 * damping if damping > _LEAST_DAMPING * _largest(work, count) else 0.0
        value = renewed(team, i, rows, u, value)
    return before, value, most, False
