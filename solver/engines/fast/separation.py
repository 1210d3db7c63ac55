"""Separation between robots, and from team mates that are not planned here (soft discs)."""

from math import sqrt

from solver.engines.fast.hinges import add_hinge
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Table, Team


@inlined
def apart(dx: float, dy: float, smooth: float) -> float:
    """Return the smoothed length of (dx, dy)."""
    return sqrt(dx * dx + dy * dy + smooth * smooth) - smooth


@kernel
def pairs_cost(team: Team, i: int) -> float:
    """Return the weighted squared hinges between robot i on work.path and its mates."""
    setting, robot, path = team.setting[0], team.robots[i], team.work[0].path
    total = 0.0
    for entry in range(robot.near[0], robot.near[1]):
        mate = team.robots[team.near[entry]].path
        for k in range(setting.steps):
            gap = setting.distance - apart(
                path[k, 0] - mate[k, 0], path[k, 1] - mate[k, 1], setting.smooth
            )
            if gap > 0.0:
                total += setting.separation * gap * gap
    return total


@kernel
def discs_cost(team: Team, i: int) -> float:
    """Return the weighted squared hinges between robot i on work.path and obstacles."""
    setting, robot, path = team.setting[0], team.robots[i], team.work[0].path
    total = 0.0
    for entry in range(robot.discs[0], robot.discs[1]):
        at = team.discs[entry]
        for k in range(setting.steps):
            gap = setting.distance - apart(
                path[k, 0] - team.obstacles[at, 0],
                path[k, 1] - team.obstacles[at, 1],
                setting.smooth,
            )
            if gap > 0.0:
                total += setting.separation * gap * gap
    return total


@kernel
def add_separation(team: Team, i: int) -> float:
    """Add the derivatives of both by the path, return their sum."""
    setting, robot, work = team.setting[0], team.robots[i], team.work[0]
    path = work.path
    total = 0.0
    for entry in range(robot.near[0], robot.near[1]):
        mate = team.robots[team.near[entry]].path
        for k in range(setting.steps):
            total += _add_one(setting, work, k, path[k, 0] - mate[k, 0], path[k, 1] - mate[k, 1])
    for entry in range(robot.discs[0], robot.discs[1]):
        x, y = team.obstacles[team.discs[entry], 0], team.obstacles[team.discs[entry], 1]
        for k in range(setting.steps):
            total += _add_one(setting, work, k, path[k, 0] - x, path[k, 1] - y)
    return total


@kernel
def _add_one(setting: Table, work: Table, k: int, dx: float, dy: float) -> float:
    length = sqrt(dx * dx + dy * dy + setting.smooth * setting.smooth)
    gap = length - setting.smooth - setting.distance
    if gap >= 0.0:
        return 0.0
    gx, gy = dx / length, dy / length
    xx, xy, yy = (1.0 - gx * gx) / length, -gx * gy / length, (1.0 - gy * gy) / length
    add_hinge(work, k, 2.0 * setting.separation, gap, gx, gy, xx, xy, yy)
    return float(setting.separation * gap * gap)
