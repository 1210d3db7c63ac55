"""Separation between robots, and from team mates that are not planned here (soft discs)."""

from math import sqrt

from solver.engines.fast.hinges import add_hinge, bears
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Table, Team

NOBODY = -1
"""In place of a robot that is left out."""


@inlined
def apart(dx: float, dy: float, smooth: float) -> float:
    """Return the smoothed length of (dx, dy)."""
    return sqrt(dx * dx + dy * dy + smooth * smooth) - smooth


@inlined
def nearness(setting: Table, dx: float, dy: float) -> float:
    """Return the weighted squared hinge of two that are (dx, dy) apart."""
    gap = setting.distance - apart(dx, dy, setting.smooth)
    return float(setting.separation * gap * gap) if gap > 0.0 else 0.0


@inlined
def pairs_cost(team: Team, i: int, skipped: int) -> float:
    """Return the weighted squared hinges between robot i on work.path and its mates.

    The mate `skipped` is left out.
    """
    setting, robot, path = team.setting[0], team.robots[i], team.work[0].path
    total = 0.0
    for entry in range(robot.near[0], robot.near[1]):
        if team.near[entry] == skipped:
            continue
        mate = team.robots[team.near[entry]].path
        for k in range(setting.steps):
            total += nearness(setting, path[k, 0] - mate[k, 0], path[k, 1] - mate[k, 1])
    return total


@inlined
def discs_cost(team: Team, i: int) -> float:
    """Return the weighted squared hinges between robot i on work.path and obstacles."""
    setting, robot, path = team.setting[0], team.robots[i], team.work[0].path
    total = 0.0
    for entry in range(robot.discs[0], robot.discs[1]):
        x, y = team.obstacles[team.discs[entry], 0], team.obstacles[team.discs[entry], 1]
        for k in range(setting.steps):
            total += nearness(setting, path[k, 0] - x, path[k, 1] - y)
    return total


@inlined
def add_separation(team: Team, i: int) -> float:
    """Add the derivatives of both by the path, return their sum."""
    setting, robot, work = team.setting[0], team.robots[i], team.work[0]
    path, shift = work.path, robot.shift
    total = 0.0
    for entry in range(robot.near[0], robot.near[1]):
        mate = team.robots[team.near[entry]]
        for k in range(setting.steps):
            dx, dy = path[k, 0] - mate.path[k, 0], path[k, 1] - mate.path[k, 1]
            sx, sy = shift[k, 0] - mate.shift[k, 0], shift[k, 1] - mate.shift[k, 1]
            total += _add_one(setting, work, k, dx, dy, sx, sy)
    for entry in range(robot.discs[0], robot.discs[1]):
        x, y = team.obstacles[team.discs[entry], 0], team.obstacles[team.discs[entry], 1]
        for k in range(setting.steps):
            dx, dy = path[k, 0] - x, path[k, 1] - y
            total += _add_one(setting, work, k, dx, dy, shift[k, 0], shift[k, 1])
    return total


@kernel
def _add_one(
    setting: Table, work: Table, k: int, dx: float, dy: float, sx: float, sy: float
) -> float:
    """Add the derivatives at the offset (dx, dy), which is about to change by (sx, sy)."""
    length = sqrt(dx * dx + dy * dy + setting.smooth * setting.smooth)
    gap = length - setting.smooth - setting.distance
    gx, gy = dx / length, dy / length
    if not bears(work, gap, gx * sx + gy * sy):
        return 0.0
    xx, xy, yy = (1.0 - gx * gx) / length, -gx * gy / length, (1.0 - gy * gy) / length
    add_hinge(work, k, 2.0 * setting.separation, gap, gx, gy, xx, xy, yy)
    return float(setting.separation * min(gap, 0.0) ** 2)
