"""Probe starts: second opinions about a robot's plan.

A descent from the last plan alone can sit for ever where the gradient vanishes (in the
middle of a zone when the target is there too, on top of a team mate), or behind a ridge that
the last plan happened to start on. Two families of fresh starts are looked at: constant plans
to the corners, sides and middle of the box, and the robot's own plan turned about a target it
watches, all of it or from some step on. The second matters because a target is seen best from
close by, in directions that change: going round it the other way is another local optimum,
and often a better one.
"""

from math import inf

from solver.arrays import FloatArray
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Team
from solver.engines.fast.robot import cost

HYSTERESIS = 1e-4
"""Relative gain below which the plan stays as it is."""

PROBES = 3
"""Most fresh starts per robot and solve; they end with the first that fails."""

_CONSTANT = 9
_TURNS = 3
"""By 90, 180 and 270 degrees."""

_CLOSE_M = 0.8
"""Plans are turned about targets nearer than this."""


@kernel
def fresh_start(team: Team, i: int, rows: int, plan: FloatArray, u: FloatArray) -> None:
    """Fill u (2H,) with the best fresh start; `plan` (2H,) is what it is to replace."""
    best, choice, pivot, first, turn = inf, 0, -1, 0, 0
    for direction in range(_CONSTANT):
        _constant_plan(team, i, direction, u)
        reached = cost(team, i, rows, u)
        if reached < best:
            best, choice = reached, direction
    if not team.setting[0].double:
        robot = team.robots[i]
        for edge in range(robot.sees[0], robot.sees[1]):
            j = team.edges[edge].target
            for start in range(team.setting[0].steps):
                for quarter in range(1, _TURNS + 1):
                    for single in range(2):
                        if not _turned_plan(team, i, j, plan, start, quarter, single, u):
                            continue
                        reached = cost(team, i, rows, u)
                        if reached < best:
                            best, pivot, first, turn = reached, j, start, 2 * quarter + single
    if pivot < 0:
        _constant_plan(team, i, choice, u)
    else:
        _turned_plan(team, i, pivot, plan, first, turn // 2, turn % 2, u)


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
    team: Team,
    i: int,
    j: int,
    plan: FloatArray,
    first: int,
    quarters: int,
    single: int,
    u: FloatArray,
) -> bool:
    """Fill u (2H,) with a plan turned about target j from step `first` on, or at it alone.

    Returns False where the plan is not close to the target then. Single integrator only.
    """
    setting, robot, target = team.setting[0], team.robots[i], team.targets[j]
    h = setting.step
    x, y = robot.position[0], robot.position[1]
    at_x, at_y = x, y
    for k in range(setting.steps):
        at_x += h * plan[2 * k]
        at_y += h * plan[2 * k + 1]
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
