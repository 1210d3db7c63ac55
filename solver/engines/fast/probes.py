"""Probe starts: second opinions about a robot's plan.

A descent from the last plan alone can sit for ever where the gradient vanishes (in the
middle of a zone when the target is there too, on top of a team mate), or behind a ridge that
the last plan happened to start on. Families of fresh starts are looked at, by number:

- constant plans, on a grid over the box;
- the chase of a target, from the first step on or after the plan's own first steps;
- the chase of one target and then of another, since a robot between two must go to one first;
- the robot's own plan turned about a target it watches, at one step or from some step on: a
  target is seen best from close by, in directions that change, and going round it the other
  way is another local optimum, and often a better one.

The last three are for single integrators. Double integrators look at their plan with its end
replaced by a constant one instead.
"""

from solver.arrays import FloatArray
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import CHOICES, COARSE, Table, Team
from solver.engines.fast.robot import copy_plan, cost

HYSTERESIS = 1e-4
"""Relative gain below which the plan stays as it is."""

ROUNDS = 3
"""Rounds of fresh starts; they end with the first round that improves nothing."""

THOROUGH_TEAM = 16
_TIRELESS_SIZE = 12

_USUAL, _THOROUGH, TIRELESS = 0, 1, 2
"""How much is spent on a robot's fresh starts: those that most often win, all but a few families,
or all of them. Teams up to THOROUGH_TEAM, and all at one step, are thorough, since time is for
many robots' first plans before one robot's second; teams of no more robots times steps than
_TIRELESS_SIZE that look further ahead than one are tireless."""

CONSTANTS = COARSE * COARSE
_FINE = 5
_GRID = _FINE * _FINE
"""Constant plans on a coarse grid, and at one step, where they are cheap, on a fine one."""

_QUARTERS = 3
_CLOSE_M = 0.8
"""Plans are turned about targets nearer than this."""

_THOROUGH_SLACK = 1.0
_LATER_SLACK = 0.1
_USUAL_SLACK = 0.01
"""Fresh starts dearer than the plan by more than this part of it are not followed up. The second is
for the rounds after the first at one step."""


@kernel
def probing_effort(robots: int, steps: int, replan: bool) -> int:
    """Return what is to be spent on a robot's fresh starts in a team of this size."""
    if steps > 1 and robots * steps <= _TIRELESS_SIZE:
        return TIRELESS
    return _THOROUGH if replan or steps == 1 or robots <= THOROUGH_TEAM else _USUAL


@kernel
def breadth(effort: int) -> int:
    """Return how many of the best starts of a round are followed up."""
    if effort == TIRELESS:
        return CHOICES
    return CHOICES - 1 if effort == _THOROUGH else 1


@kernel
def _constants(steps: int) -> int:
    """Return the number of constant plans that are looked at."""
    return _GRID if steps == 1 else CONSTANTS


@kernel
def _numbers(team: Team, i: int) -> int:
    """Return how many fresh starts there are for robot i."""
    setting, robot = team.setting[0], team.robots[i]
    steps: int = setting.steps
    constants = _constants(steps)
    if setting.double:
        return constants + CONSTANTS * (steps - 1)
    targets = robot.sees[1] - robot.sees[0]
    alone = targets * steps * (1 + 2 * _QUARTERS)
    return constants + int(alone + targets * targets * (steps - 1))


@kernel
def rank_starts(team: Team, i: int, rows: int, value: float, later: bool) -> None:
    """Fill work.choices with the numbers of the best fresh starts for robot i, -1 for none.

    The plan to be replaced stands in work.base (2H,) and costs `value`. What does not depend on
    it has been looked at in `later` rounds at one step.
    """
    robot, work, steps = team.robots[i], team.work[0], team.setting[0].steps
    slack = _THOROUGH_SLACK if robot.effort > _USUAL else _USUAL_SLACK
    first = 0
    if steps == 1 and later:
        slack = min(slack, _LATER_SLACK)
        first = _GRID + robot.sees[1] - robot.sees[0]
    most = breadth(robot.effort)
    forget(work, value + slack * abs(value))
    if steps == 1 and not later:
        first = _GRID
        for number in range(_GRID):
            hold(robot, _FINE, number, 0, 1, work.u)
            work.grid[number] = cost(team, i, rows, work.u)
        for number in range(_GRID):
            if is_valley(work.grid, number, _FINE, 2):
                remember(work, number, work.grid[number], most)
    for number in range(first, _numbers(team, i)):
        if robot.effort < TIRELESS and not _is_worth_it(team, i, number):
            continue
        if fresh_start(team, i, number, work.u):
            remember(work, number, cost(team, i, rows, work.u), most)


@kernel
def forget(work: Table, limit: float) -> None:
    """Make choices and prices those of nothing; what is dearer than `limit` is no choice."""
    for slot in range(CHOICES):
        work.choices[slot], work.prices[slot] = -1, limit


@kernel
def remember(work: Table, number: int, price: float, most: int) -> None:
    """Put a start among the best `most` ones where it belongs, the cheapest first."""
    slot = most - 1
    while slot >= 0 and price < work.prices[slot]:
        if slot + 1 < most:
            work.prices[slot + 1] = work.prices[slot]
            work.choices[slot + 1] = work.choices[slot]
        work.prices[slot], work.choices[slot] = price, number
        slot -= 1


@kernel
def is_valley(grid: FloatArray, at: int, side: int, axes: int) -> bool:
    """Return whether no neighbour on the grid is cheaper: descents from there would meet."""
    stride = 1
    for _ in range(axes):
        place = at // stride % side
        if place > 0 and grid[at - stride] < grid[at]:
            return False
        if place + 1 < side and grid[at + stride] < grid[at]:
            return False
        stride *= side
    return True


@kernel
def _is_worth_it(team: Team, i: int, number: int) -> bool:
    """Return whether a start is worth a look in a team that is too large for all of them.

    Thorough robots leave out late and second chases. The others look at their plan turned by
    half a circle, at the chase, and near hazards at the constant plans.
    """
    robot, steps = team.robots[i], team.setting[0].steps
    constants = _constants(steps)
    if number < constants:
        near = robot.keeps[0] < robot.keeps[1] or robot.jams[0] < robot.jams[1]
        return bool(near or robot.effort > _USUAL)
    if team.setting[0].double:
        return False
    targets = robot.sees[1] - robot.sees[0]
    kind, step = (number - constants) // targets // steps, (number - constants) // targets % steps
    if kind == 0:
        return bool(step == 0)
    if kind > 2 * _QUARTERS:
        return False
    return bool(robot.effort > _USUAL or (kind - 1) // 2 == 1)


@kernel
def fresh_start(team: Team, i: int, number: int, u: FloatArray) -> bool:
    """Fill u (2H,) with a start by its number; return False where it makes no sense."""
    steps = team.setting[0].steps
    constants = _constants(steps)
    if number < constants:
        hold(team.robots[i], _FINE if steps == 1 else COARSE, number, 0, steps, u)
        return True
    number -= constants
    if team.setting[0].double:
        copy_plan(team, team.work[0].base, u)
        hold(team.robots[i], COARSE, number % CONSTANTS, 1 + number // CONSTANTS, steps, u)
        return True
    first = team.robots[i].sees[0]
    targets = team.robots[i].sees[1] - first
    j = team.edges[first + number % targets].target
    step = number // targets % steps
    kind = number // targets // steps
    if kind == 0:
        copy_plan(team, team.work[0].base, u)
        _chase(team, i, j, step, u)
        return True
    if kind <= 2 * _QUARTERS:
        single = (kind - 1) % 2
        if single == 1 and step == steps - 1:
            return False
        return turned_plan(team, i, j, step, 1 + (kind - 1) // 2, single, u)
    number -= targets * steps * (1 + 2 * _QUARTERS)
    other = team.edges[first + number // targets % targets].target
    if other == j:
        return False
    _chase(team, i, j, 0, u)
    _chase(team, i, other, 1 + number // targets // targets, u)
    return True


@kernel
def hold(robot: Table, side: int, number: int, first: int, steps: int, u: FloatArray) -> None:
    """Fill u (2H,) from step `first` on with a constant plan on a grid over the box.

    The grid has `side` lines each way; rest is in its middle.
    """
    half = side // 2
    for at in range(2 * first, 2 * steps):
        place = (number // side if at % 2 == 0 else number % side) - half
        lower, upper = robot.lower[at], robot.upper[at]
        value = upper if place > 0 else lower
        u[at] = min(max(value * abs(place) / half if place != 0 else 0.0, lower), upper)


@kernel
def _chase(team: Team, i: int, j: int, first: int, u: FloatArray) -> None:
    """Fill u (2H,) from step `first` on with the chase of target j, as fast as the box allows."""
    setting, robot, means = team.setting[0], team.robots[i], team.targets[j].means
    h = setting.step
    for axis in range(2):
        x = robot.position[axis]
        for k in range(setting.steps):
            at = 2 * k + axis
            if k >= first:
                u[at] = min(max((means[k, axis] - x) / h, robot.lower[at]), robot.upper[at])
            x += h * u[at]


@kernel
def turned_plan(
    team: Team, i: int, j: int, first: int, quarters: int, single: int, u: FloatArray
) -> bool:
    """Fill u (2H,) with work.base turned about target j from step `first` on, or then alone.

    Returns False where the plan is not close to the target then. Single integrator only.
    """
    setting, robot, target, base = (
        team.setting[0],
        team.robots[i],
        team.targets[j],
        team.work[0].base,
    )
    h = setting.step
    x, y = robot.position[0], robot.position[1]
    at_x, at_y = x, y
    for k in range(setting.steps):
        at_x += h * base[2 * k]
        at_y += h * base[2 * k + 1]
        to_x, to_y = at_x, at_y
        if k == first or (k > first and single == 0):
            dx, dy = at_x - target.means[k, 0], at_y - target.means[k, 1]
            if k == first and dx * dx + dy * dy > _CLOSE_M * _CLOSE_M:
                return False
            for _ in range(quarters):
                dx, dy = -dy, dx
            to_x, to_y = target.means[k, 0] + dx, target.means[k, 1] + dy
        u[2 * k] = min(max((to_x - x) / h, robot.lower[2 * k]), robot.upper[2 * k])
        u[2 * k + 1] = min(max((to_y - y) / h, robot.lower[2 * k + 1]), robot.upper[2 * k + 1])
        x += h * u[2 * k]
        y += h * u[2 * k + 1]
    return True
