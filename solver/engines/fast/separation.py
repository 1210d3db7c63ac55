"""Separation between robots, and from team mates that are not planned here (soft discs)."""

from math import sqrt

from solver.arrays import FloatArray
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Pairs, Plans
from solver.engines.fast.zones import add_hinge


@inlined
def apart(dx: float, dy: float, smoothing: float) -> float:
    """Return the smoothed length of (dx, dy)."""
    return sqrt(dx * dx + dy * dy + smoothing * smoothing) - smoothing


@kernel
def pairs_cost(pairs: Pairs, plans: Plans, i: int, path: FloatArray, smoothing: float) -> float:
    """Return the weighted squared hinges between robot i on `path` (H, 2) and its mates."""
    total = 0.0
    for edge in range(pairs.start[i], pairs.start[i + 1]):
        mate = pairs.mate[edge]
        for k in range(path.shape[0]):
            gap = pairs.distance - apart(
                path[k, 0] - plans.paths[mate, k, 0],
                path[k, 1] - plans.paths[mate, k, 1],
                smoothing,
            )
            if gap > 0.0:
                total += pairs.weight * gap * gap
    return total


@kernel
def obstacles_cost(pairs: Pairs, i: int, path: FloatArray, smoothing: float) -> float:
    """Return the weighted squared hinges between robot i on `path` (H, 2) and obstacles."""
    total = 0.0
    for edge in range(pairs.obstacle_start[i], pairs.obstacle_start[i + 1]):
        at = pairs.obstacle[edge]
        for k in range(path.shape[0]):
            gap = pairs.distance - apart(
                path[k, 0] - pairs.obstacles[at, 0], path[k, 1] - pairs.obstacles[at, 1], smoothing
            )
            if gap > 0.0:
                total += pairs.weight * gap * gap
    return total


@kernel
def add_separation(
    pairs: Pairs,
    plans: Plans,
    i: int,
    path: FloatArray,
    smoothing: float,
    slope: FloatArray,
    bend: FloatArray,
) -> float:
    """Add the derivatives of both by the path, return their sum."""
    total = 0.0
    for edge in range(pairs.start[i], pairs.start[i + 1]):
        mate = pairs.mate[edge]
        for k in range(path.shape[0]):
            dx = path[k, 0] - plans.paths[mate, k, 0]
            dy = path[k, 1] - plans.paths[mate, k, 1]
            total += _add_one(pairs, dx, dy, smoothing, k, slope, bend)
    for edge in range(pairs.obstacle_start[i], pairs.obstacle_start[i + 1]):
        at = pairs.obstacle[edge]
        for k in range(path.shape[0]):
            dx = path[k, 0] - pairs.obstacles[at, 0]
            dy = path[k, 1] - pairs.obstacles[at, 1]
            total += _add_one(pairs, dx, dy, smoothing, k, slope, bend)
    return total


@inlined
def _add_one(
    pairs: Pairs,
    dx: float,
    dy: float,
    smoothing: float,
    k: int,
    slope: FloatArray,
    bend: FloatArray,
) -> float:
    length = sqrt(dx * dx + dy * dy + smoothing * smoothing)
    gap = length - smoothing - pairs.distance
    if gap >= 0.0:
        return 0.0
    gx, gy = dx / length, dy / length
    add_hinge(
        2.0 * pairs.weight,
        gap,
        gx,
        gy,
        (1.0 - gx * gx) / length,
        -gx * gy / length,
        (1.0 - gy * gy) / length,
        k,
        slope,
        bend,
    )
    return pairs.weight * gap * gap
