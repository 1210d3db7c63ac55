"""Jamming: the keep-out of a communication zone grows with the spread of the team.

The spread seen by robot i is a soft maximum over its team mates,
D_i = tau log sum_l exp(d_il / tau). Moving robot i changes its own rows, and the rows of
every mate l that could be jammed: both are in robot i's problem, or sweeps over the robots
would not descend the team's objective.
"""

from math import exp, log

from solver.engines.fast.hinges import add_hinge
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Team
from solver.engines.fast.separation import apart
from solver.engines.fast.zones import clearance, clearance_derivatives

NEGLIGIBLE = 36.0
"""exp(-36) = 2e-16: mates nearer than the farthest by this many tau do not matter."""


@kernel
def measure(team: Team, i: int, k: int, x: float, y: float, skipped: int) -> float:
    """Fill team.lengths with the distances of robot i's mates from (x, y) at step k.

    The mate `skipped` is left out. Returns the largest.
    """
    robot, smooth = team.robots[i], team.setting[0].smooth
    farthest = 0.0
    at = 0
    for entry in range(robot.mates[0], robot.mates[1]):
        mate = team.mates[entry]
        if mate != skipped:
            path = team.robots[mate].path
            length = apart(x - path[k, 0], y - path[k, 1], smooth)
            team.lengths[at] = length
            farthest = max(farthest, length)
            at += 1
    return farthest


@kernel
def weigh(team: Team, count: int, farthest: float) -> float:
    """Replace `count` lengths by their exponentials relative to the farthest; return the sum."""
    blend = team.setting[0].blend
    total = 0.0
    for at in range(count):
        power = (team.lengths[at] - farthest) / blend
        team.lengths[at] = exp(power) if power > -NEGLIGIBLE else 0.0
        total += team.lengths[at]
    return total


@kernel
def jamming_cost(team: Team, i: int) -> float:
    """Return the weighted squared hinges of robot i's own communication zones."""
    setting, robot, path = team.setting[0], team.robots[i], team.work[0].path
    total = 0.0
    first, last = robot.jams[0], robot.jams[1]
    count = robot.mates[1] - robot.mates[0]
    for k in range(setting.steps):
        x, y = path[k, 0], path[k, 1]
        farthest = measure(team, i, k, x, y, -1)
        most = farthest + setting.blend * log(count) if count > 0 else 0.0
        spread = -1.0
        for entry in range(first, last):
            zone = team.jam_zones[team.jams[entry].zone]
            gap = clearance(zone, x, y, setting.smooth)
            if gap >= zone.margin * most:
                continue
            if spread < 0.0:
                spread = 0.0
                if count > 0:
                    spread = farthest + setting.blend * log(weigh(team, count, farthest))
            gap -= zone.margin * spread
            if gap < 0.0:
                total += zone.weight * gap * gap
    return total


@kernel
def add_jamming(team: Team, i: int) -> float:
    """Add the derivatives of the same by the path, return it."""
    setting, robot, work = team.setting[0], team.robots[i], team.work[0]
    total = 0.0
    first, last = robot.jams[0], robot.jams[1]
    count = robot.mates[1] - robot.mates[0]
    for k in range(setting.steps):
        x, y = work.path[k, 0], work.path[k, 1]
        farthest = measure(team, i, k, x, y, -1)
        most = farthest + setting.blend * log(count) if count > 0 else 0.0
        spread = -1.0
        sx = sy = sxx = sxy = syy = 0.0
        for entry in range(first, last):
            zone = team.jam_zones[team.jams[entry].zone]
            gap, gx, gy, xx, xy, yy = clearance_derivatives(zone, x, y, setting.smooth)
            margin = zone.margin
            if gap >= margin * most:
                continue
            if spread < 0.0:
                spread = 0.0
                if count > 0:
                    weight = weigh(team, count, farthest)
                    spread = farthest + setting.blend * log(weight)
                    sx, sy, sxx, sxy, syy = _spread_derivatives(team, i, k, x, y, weight)
            gap -= margin * spread
            if gap < 0.0:
                total += zone.weight * gap * gap
                gx -= margin * sx
                gy -= margin * sy
                xx -= margin * sxx
                xy -= margin * sxy
                yy -= margin * syy
                add_hinge(work, k, 2.0 * zone.weight, gap, gx, gy, xx, xy, yy)
    return total


@kernel
def _spread_derivatives(
    team: Team, i: int, k: int, x: float, y: float, total: float
) -> tuple[float, float, float, float, float]:
    """Return gradient and Hessian (xx, xy, yy) of the soft maximum weighed in team.lengths."""
    setting, robot = team.setting[0], team.robots[i]
    gx = gy = xx = xy = yy = 0.0
    sharp = 1.0 / setting.blend
    for entry in range(robot.mates[0], robot.mates[1]):
        weight = team.lengths[entry - robot.mates[0]] / total
        if weight == 0.0:
            continue
        path = team.robots[team.mates[entry]].path
        dx, dy = x - path[k, 0], y - path[k, 1]
        length = apart(dx, dy, setting.smooth) + setting.smooth
        dx /= length
        dy /= length
        gx += weight * dx
        gy += weight * dy
        xx += weight * ((1.0 - dx * dx) / length + sharp * dx * dx)
        xy += weight * (sharp - 1.0 / length) * dx * dy
        yy += weight * ((1.0 - dy * dy) / length + sharp * dy * dy)
    return gx, gy, xx - sharp * gx * gx, xy - sharp * gx * gy, yy - sharp * gy * gy


@inlined
def refresh_clearance(team: Team, i: int) -> None:
    """Keep the clearances of robot i's plan that its mates' problems read."""
    setting, robot = team.setting[0], team.robots[i]
    for entry in range(robot.jams[0], robot.jams[1]):
        jam = team.jams[entry]
        zone = team.jam_zones[jam.zone]
        for k in range(setting.steps):
            jam.clearance[k] = clearance(zone, robot.path[k, 0], robot.path[k, 1], setting.smooth)
