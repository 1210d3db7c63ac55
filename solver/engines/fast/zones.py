"""Keep-out zones: the smoothed clearance and its derivatives (contract of the objective).

With a = mean - x: clearance = sqrt(a'a + e^2) - e - q sqrt((a'S a + e^2 tr S / 2) / (a'a + e^2)),
the distance beyond the chance-constrained radius in the direction of the zone's centre.
"""

from math import sqrt

from solver.arrays import FloatArray
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Zones

_LEAST = 1e-18


@inlined
def clearance(zones: Zones, s: int, x: float, y: float, smoothing: float) -> float:
    """Return the clearance of the point (x, y) from zone s, margin not subtracted."""
    ax = zones.centres[s, 0] - x
    ay = zones.centres[s, 1] - y
    soft = smoothing * smoothing
    squared = ax * ax + ay * ay + soft
    xx, xy, yy = zones.covariances[s, 0, 0], zones.covariances[s, 0, 1], zones.covariances[s, 1, 1]
    spread = (ax * ax * xx + 2.0 * ax * ay * xy + ay * ay * yy + 0.5 * soft * (xx + yy)) / squared
    return sqrt(squared) - smoothing - zones.quantiles[s] * sqrt(max(spread, _LEAST))


@inlined
def clearance_derivatives(
    zones: Zones, s: int, x: float, y: float, smoothing: float
) -> tuple[float, float, float, float, float, float]:
    """Return clearance, its gradient (x, y) and its Hessian (xx, xy, yy)."""
    ax = zones.centres[s, 0] - x
    ay = zones.centres[s, 1] - y
    q = zones.quantiles[s]
    soft = smoothing * smoothing
    squared = ax * ax + ay * ay + soft
    distance = sqrt(squared)
    xx, xy, yy = zones.covariances[s, 0, 0], zones.covariances[s, 0, 1], zones.covariances[s, 1, 1]
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
        distance - smoothing - q * spread,
        q * half * mx - ax * inverse,
        q * half * my - ay * inverse,
        inverse - ax * ax * cube - q * rxx,
        -ax * ay * cube - q * rxy,
        inverse - ay * ay * cube - q * ryy,
    )


@kernel
def keep_out_cost(zones: Zones, i: int, path: FloatArray, smoothing: float) -> float:
    """Return the weighted squared hinges of robot i's sensing zones along its path (H, 2)."""
    total = 0.0
    for edge in range(zones.start[i], zones.start[i + 1]):
        s = zones.zone[edge]
        for k in range(path.shape[0]):
            gap = clearance(zones, s, path[k, 0], path[k, 1], smoothing) - zones.margins[s]
            if gap < 0.0:
                total += zones.weights[s] * gap * gap
    return total


@kernel
def add_keep_out(
    zones: Zones, i: int, path: FloatArray, smoothing: float, slope: FloatArray, bend: FloatArray
) -> float:
    """Add the derivatives of the same by the path, return it."""
    total = 0.0
    for edge in range(zones.start[i], zones.start[i + 1]):
        s = zones.zone[edge]
        for k in range(path.shape[0]):
            value, gx, gy, xx, xy, yy = clearance_derivatives(
                zones, s, path[k, 0], path[k, 1], smoothing
            )
            gap = value - zones.margins[s]
            if gap < 0.0:
                total += zones.weights[s] * gap * gap
                add_hinge(2.0 * zones.weights[s], gap, gx, gy, xx, xy, yy, k, slope, bend)
    return total


@inlined
def add_hinge(
    twice: float,
    gap: float,
    gx: float,
    gy: float,
    xx: float,
    xy: float,
    yy: float,
    k: int,
    slope: FloatArray,
    bend: FloatArray,
) -> None:
    """Add the derivatives of `twice / 2 * gap^2` to step k's gradient and diagonal block."""
    slope[k, 0] += twice * gap * gx
    slope[k, 1] += twice * gap * gy
    at = 2 * k
    cross = twice * (gx * gy + gap * xy)
    bend[at, at] += twice * (gx * gx + gap * xx)
    bend[at, at + 1] += cross
    bend[at + 1, at] += cross
    bend[at + 1, at + 1] += twice * (gy * gy + gap * yy)
