"""Keep-out zones: the smoothed clearance and its derivatives (contract of the objective).

With a = mean - x: clearance = sqrt(a'a + e^2) - e - q sqrt((a'S a + e^2 tr S / 2) / (a'a + e^2)),
the distance beyond the chance-constrained radius in the direction of the zone's centre.
"""

from math import sqrt

from solver.engines.fast.hinges import add_hinge, bears
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Table, Team

_LEAST = 1e-30
"""Least variance, so that a zone without extent has no division by zero."""


@kernel
def clearance(zone: Table, x: float, y: float, smooth: float) -> float:
    """Return the clearance of the point (x, y) from a zone, margin not subtracted."""
    ax = zone.centre[0] - x
    ay = zone.centre[1] - y
    soft = smooth * smooth
    squared = ax * ax + ay * ay + soft
    xx, xy, yy = zone.covariance[0], zone.covariance[1], zone.covariance[2]
    spread = (ax * ax * xx + 2.0 * ax * ay * xy + ay * ay * yy + 0.5 * soft * (xx + yy)) / squared
    return sqrt(squared) - smooth - float(zone.quantile) * sqrt(max(spread, _LEAST))


@kernel
def clearance_derivatives(
    zone: Table, x: float, y: float, smooth: float
) -> tuple[float, float, float, float, float, float]:
    """Return clearance, its gradient (x, y) and its Hessian (xx, xy, yy)."""
    ax = zone.centre[0] - x
    ay = zone.centre[1] - y
    q = zone.quantile
    soft = smooth * smooth
    squared = ax * ax + ay * ay + soft
    distance = sqrt(squared)
    xx, xy, yy = zone.covariance[0], zone.covariance[1], zone.covariance[2]
    sx = xx * ax + xy * ay
    sy = xy * ax + yy * ay
    variance = max((ax * sx + ay * sy + 0.5 * soft * (xx + yy)) / squared, _LEAST)
    spread = sqrt(variance)
    # Gradient m and Hessian of the variance by a; then of its square root.
    scale = 2.0 / squared
    mx = scale * (sx - variance * ax)
    my = scale * (sy - variance * ay)
    half = 0.5 / spread
    bow = 0.25 / (spread * variance)
    rxx = half * scale * (xx - variance - 2.0 * ax * mx) - bow * mx * mx
    rxy = half * scale * (xy - ax * my - ay * mx) - bow * mx * my
    ryy = half * scale * (yy - variance - 2.0 * ay * my) - bow * my * my
    inverse = 1.0 / distance
    cube = inverse / squared
    return (
        distance - smooth - q * spread,
        q * half * mx - ax * inverse,
        q * half * my - ay * inverse,
        inverse - ax * ax * cube - q * rxx,
        -ax * ay * cube - q * rxy,
        inverse - ay * ay * cube - q * ryy,
    )


@inlined
def keep_out_cost(team: Team, i: int) -> float:
    """Return the weighted squared hinges of robot i's sensing zones along work.path."""
    setting, robot, path = team.setting[0], team.robots[i], team.work[0].path
    total = 0.0
    for entry in range(robot.keeps[0], robot.keeps[1]):
        zone = team.keep_zones[team.keeps[entry]]
        for k in range(setting.steps):
            gap = clearance(zone, path[k, 0], path[k, 1], setting.smooth) - zone.margin
            if gap < 0.0:
                total += zone.weight * gap * gap
    return total


@inlined
def add_keep_out(team: Team, i: int) -> float:
    """Add the derivatives of the same by the path, return it."""
    setting, robot, work = team.setting[0], team.robots[i], team.work[0]
    total = 0.0
    for entry in range(robot.keeps[0], robot.keeps[1]):
        zone = team.keep_zones[team.keeps[entry]]
        for k in range(setting.steps):
            value, gx, gy, xx, xy, yy = clearance_derivatives(
                zone, work.path[k, 0], work.path[k, 1], setting.smooth
            )
            gap = value - zone.margin
            if bears(work, gap, gx * robot.shift[k, 0] + gy * robot.shift[k, 1]):
                total += zone.weight * min(gap, 0.0) ** 2
                add_hinge(work, k, 2.0 * zone.weight, gap, gx, gy, xx, xy, yy)
    return total
