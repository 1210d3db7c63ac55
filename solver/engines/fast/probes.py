"""Probe starts: second opinions about a robot's plan.

A descent from the last plan alone can sit for ever where the gradient vanishes (in the
middle of a zone when the target is there too, on top of a team mate), or behind a ridge that
the last plan happened to start on. Three families of fresh starts are looked at: constant
plans to the corners, sides and middle of the box; the chase of a target; and the robot's own
plan turned about a target it watches, at one step or from some step on. The last one matters
because a target is seen best from close by, in directions that change: going round it the
other way is another local optimum, and often a better one.
"""

from solver.arrays import FloatArray
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import CHOICES, Team
from solver.engines.fast.robot import cost

HYSTERESIS = 1e-4
"""Relative gain below which the plan stays as it is."""

ROUNDS = 3
"""Rounds of fresh starts; they end with the first round that improves nothing."""

THOROUGH_TEAM = 16
"""Teams up to this size, and all at one step, look at every fresh start, larger ones at those
that most often win: time is for many robots' first plans before one robot's second."""

_CONSTANT = 9
_QUARTERS = 3
_CLOSE_M = 0.8
"""Plans are turned about targets nearer than this."""

_THOROUGH_SLACK = 1.0
_USUAL_SLACK = 0.01
"""Fresh starts dearer than the plan by more than this part of it are not followed up."""


@kernel
def rank_starts(team: Team, i: int, rows: int, value: float) -> None:
    """Fill work.choices with the numbers of the best fresh starts for robot i, -1 for none.

    The plan to be replaced stands in work.base (2H,) and costs `value`.
    """
    robot, work = team.robots[i], team.work[0]
    steps = team.setting[0].steps
    slack = _THOROUGH_SLACK if robot.thorough else _USUAL_SLACK
    for slot in range(CHOICES):
        work.choices[slot] = -1
        work.prices[slot] = value + slack * abs(value)
    count = _CONSTANT
    if not team.setting[0].double:
        count += (robot.sees[1] - robot.sees[0]) * (1 + 2 * _QUARTERS * steps)
    for number in range(count):
        if not (robot.thorough or _often_wins(team, i, number)):
            continue
        if fresh_start(team, i, number, work.u):
            price = cost(team, i, rows, work.u)
            slot = CHOICES - 1
            while slot >= 0 and price < work.prices[slot]:
                if slot + 1 < CHOICES:
                    work.prices[slot + 1] = work.prices[slot]
                    work.choices[slot + 1] = work.choices[slot]
                work.prices[slot] = price
                work.choices[slot] = number
                slot -= 1


@kernel
def _often_wins(team: Team, i: int, number: int) -> bool:
    """Return whether a start is worth a look in a large team.

    That is the plan turned by half a circle, the chase, and near hazards the constant plans.
    """
    robot = team.robots[i]
    if number < _CONSTANT:
        return bool(robot.keeps[0] < robot.keeps[1] or robot.jams[0] < robot.jams[1])
    kind = (number - _CONSTANT) % (1 + 2 * _QUARTERS * team.setting[0].steps)
    return bool(kind == 0 or (kind - 1) % (2 * _QUARTERS) // 2 == 1)


@kernel
def fresh_start(team: Team, i: int, number: int, u: FloatArray) -> bool:
    """Fill u (2H,) with a start by its number; return False where it makes no sense."""
    if number < _CONSTANT:
        _constant_plan(team, i, number, u)
        return True
    steps = team.setting[0].steps
    per_target = 1 + 2 * _QUARTERS * steps
    slot, kind = (number - _CONSTANT) // per_target, (number - _CONSTANT) % per_target
    j = team.edges[team.robots[i].sees[0] + slot].target
    if kind == 0:
        return _turned_plan(team, i, j, -1, 0, 0, u)
    step, turn = (kind - 1) // (2 * _QUARTERS), (kind - 1) % (2 * _QUARTERS)
    if turn % 2 == 1 and step == steps - 1:
        return False
    return _turned_plan(team, i, j, step, 1 + turn // 2, turn % 2, u)


@kernel
def _constant_plan(team: Team, i: int, direction: int, u: FloatArray) -> None:
    """Fill u (2H,) with one of nine constant plans: rest, or a corner or side of the box."""
    robot = team.robots[i]
    for at in range(2 * team.setting[0].steps):
        sign = (direction // 3 if at % 2 == 0 else direction % 3) - 1
        lower, upper = robot.lower[at], robot.upper[at]
        if sign == 0:
            u[at] = min(max(0.0, lower), upper)
        else:
            u[at] = upper if sign > 0 else lower


@kernel
def _turned_plan(
    team: Team, i: int, j: int, first: int, quarters: int, single: int, u: FloatArray
) -> bool:
    """Fill u (2H,) with work.base turned about target j from step `first` on, or then alone.

    A negative `first` asks for the chase of the target instead. Returns False where the plan
    is not close to the target then. Single integrator only.
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
        if first < 0:
            to_x, to_y = target.means[k, 0], target.means[k, 1]
        elif k == first or (k > first and single == 0):
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
