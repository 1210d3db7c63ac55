"""Sparse lists of what can matter within the horizon: everything beyond reach is left out.

Each bound below is safe: an entry left out contributes nothing (or, for information and soft
maxima, nothing that double precision could show) wherever the robots can get.
"""

from math import exp, hypot, log, sqrt

import numpy as np

from solver.arrays import BoolArray, FloatArray, IntArray
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Mates, Motion, Smoothing
from solver.engines.fast.spread import NEGLIGIBLE

_NO_INFORMATION = 1e-11
"""Relative change of a target's covariance that is left out."""


@kernel
def transposed(entries: IntArray, rows: int) -> tuple[IntArray, IntArray]:
    """Return start (rows + 1,) and the indices of the entries by their value, in order."""
    start = np.zeros(rows + 1, np.int64)
    for at in range(entries.shape[0]):
        start[entries[at] + 1] += 1
    for row in range(rows):
        start[row + 1] += start[row]
    fill = start[:-1].copy()
    order = np.empty(entries.shape[0], np.int64)
    for at in range(entries.shape[0]):
        order[fill[entries[at]]] = at
        fill[entries[at]] += 1
    return start, order


@kernel
def sight_edges(
    motion: Motion,
    seen: IntArray,
    means: FloatArray,
    priors: FloatArray,
    growth: FloatArray,
    sensor: FloatArray,
) -> tuple[IntArray, IntArray, IntArray]:
    """Return start (M + 1,), target (E,), robot (E,) of the flat indices `seen` into (M, N)."""
    robots, targets = motion.positions.shape[0], priors.shape[0]
    start = np.zeros(robots + 1, np.int64)
    target = np.empty(seen.shape[0], np.int64)
    robot = np.empty(seen.shape[0], np.int64)
    count = 0
    for at in range(seen.shape[0]):
        i, j = seen[at] // targets, seen[at] % targets
        if _can_tell(motion, i, j, means, priors, growth, sensor):
            target[count] = j
            robot[count] = i
            start[i + 1] += 1
            count += 1
    for i in range(robots):
        start[i + 1] += start[i]
    return start, target[:count].copy(), robot[:count].copy()


@kernel
def _can_tell(
    motion: Motion,
    i: int,
    j: int,
    means: FloatArray,
    priors: FloatArray,
    growth: FloatArray,
    sensor: FloatArray,
) -> bool:
    """Return whether robot i could learn anything of target j within the horizon."""
    variance = priors[j, 0] + priors[j, 2]
    nearest = np.inf
    for k in range(means.shape[0]):
        if k > 0:
            variance += growth[k, j, 0, 0] + growth[k, j, 1, 1]
        dx = means[k, j, 0] - motion.positions[i, 0]
        dy = means[k, j, 1] - motion.positions[i, 1]
        nearest = min(nearest, sqrt(dx * dx + dy * dy))
    nearest = max(nearest - motion.reach[i], 0.0)
    squared = nearest * nearest + sensor[4]
    most = sensor[0] * exp(-sensor[1] * nearest) + sensor[2] * exp(-sensor[3] * nearest) / squared
    return most * variance > _NO_INFORMATION


@kernel
def zone_edges(
    motion: Motion,
    known: BoolArray,
    centres: FloatArray,
    covariances: FloatArray,
    quantiles: FloatArray,
    weights: FloatArray,
    margins: FloatArray,
    spread: FloatArray,
    smoothing: float,
) -> tuple[IntArray, IntArray]:
    """Return start (M + 1,) and zone (E,) of the known zones that can bind.

    `spread` (M,) multiplies the margin: one for sensing zones, the greatest possible distance
    to a team mate for communication zones.
    """
    robots, zones = known.shape
    start = np.zeros(robots + 1, np.int64)
    zone = np.empty(robots * zones, np.int64)
    count = 0
    for i in range(robots):
        for s in range(zones):
            if not known[i, s] or not weights[s] > 0.0:
                continue
            xx, xy, yy = covariances[s, 0, 0], covariances[s, 0, 1], covariances[s, 1, 1]
            widest = 0.5 * (xx + yy) + hypot(0.5 * (xx - yy), xy)
            radius = max(quantiles[s], 0.0) * sqrt(max(widest, 0.0)) + margins[s] * spread[i]
            distance = hypot(
                centres[s, 0] - motion.positions[i, 0], centres[s, 1] - motion.positions[i, 1]
            )
            if distance < radius + motion.reach[i] + smoothing:
                zone[count] = s
                count += 1
        start[i + 1] = count
    return start, zone[:count].copy()


@kernel
def widest_spread(motion: Motion, known: BoolArray, smooth: Smoothing) -> FloatArray:
    """Return (M,) an upper bound of the spread each robot can see within the horizon.

    Robots that know no zone get zero: nothing asks for their bound.
    """
    robots = known.shape[0]
    spread = np.zeros(robots)
    for i in range(robots):
        if robots == 1 or not known[i].any():
            continue
        for mate in range(robots):
            if mate != i:
                distance = hypot(
                    motion.positions[i, 0] - motion.positions[mate, 0],
                    motion.positions[i, 1] - motion.positions[mate, 1],
                )
                spread[i] = max(spread[i], distance + motion.reach[mate])
        spread[i] += motion.reach[i] + smooth.mates * log(robots - 1.0)
    return spread


@kernel
def mate_lists(motion: Motion, jam_start: IntArray, smooth: Smoothing) -> Mates:
    """List, for each robot that can be jammed, the mates that can be its farthest."""
    robots = motion.positions.shape[0]
    start = np.zeros(robots + 1, np.int64)
    least = np.zeros(robots)
    for i in range(robots):
        start[i + 1] = start[i]
        if jam_start[i] == jam_start[i + 1]:
            continue
        for mate in range(robots):
            if mate != i:
                near, _ = _range(motion, i, mate)
                least[i] = max(least[i], near)
        least[i] -= NEGLIGIBLE * smooth.mates + smooth.zone
        for mate in range(robots):
            if mate != i and _range(motion, i, mate)[1] >= least[i]:
                start[i + 1] += 1
    mates = np.empty(start[robots], np.int64)
    owners = np.empty(start[robots], np.int64)
    count = 0
    for i in range(robots):
        if start[i] == start[i + 1]:
            continue
        for mate in range(robots):
            if mate != i and _range(motion, i, mate)[1] >= least[i]:
                mates[count] = mate
                owners[count] = i
                count += 1
    row_start, order = transposed(mates, robots)
    return Mates(start=start, mate=mates, row_start=row_start, row=owners[order])


@kernel
def _range(motion: Motion, i: int, mate: int) -> tuple[float, float]:
    """Return the least and the greatest distance of two robots within the horizon."""
    distance = hypot(
        motion.positions[i, 0] - motion.positions[mate, 0],
        motion.positions[i, 1] - motion.positions[mate, 1],
    )
    reach = motion.reach[i] + motion.reach[mate]
    return max(distance - reach, 0.0), distance + reach


@kernel
def near_pairs(motion: Motion, distance: float, smoothing: float) -> tuple[IntArray, IntArray]:
    """Return start (M + 1,) and mate (E,) of the pairs that can come nearer than `distance`.

    Robots are swept in the order of x, so that far ones never meet. Each pair stands twice.
    """
    robots = motion.positions.shape[0]
    order = np.argsort(motion.positions[:, 0])
    farthest = 0.0
    for i in range(robots):
        farthest = max(farthest, motion.reach[i])
    left = np.empty(4 * robots, np.int64)
    right = np.empty(4 * robots, np.int64)
    count = 0
    for first in range(robots):
        i = order[first]
        for second in range(first + 1, robots):
            mate = order[second]
            dx = motion.positions[mate, 0] - motion.positions[i, 0]
            if dx > distance + smoothing + motion.reach[i] + farthest:
                break
            dy = motion.positions[mate, 1] - motion.positions[i, 1]
            if hypot(dx, dy) < distance + smoothing + motion.reach[i] + motion.reach[mate]:
                if count + 2 > left.shape[0]:
                    left = np.concatenate((left, np.empty_like(left)))
                    right = np.concatenate((right, np.empty_like(right)))
                left[count], right[count] = i, mate
                left[count + 1], right[count + 1] = mate, i
                count += 2
    start, by_robot = transposed(left[:count], robots)
    return start, right[:count][by_robot]


@kernel
def near_obstacles(
    motion: Motion, obstacles: FloatArray, distance: float, smoothing: float
) -> tuple[IntArray, IntArray]:
    """Return start (M + 1,) and obstacle (E,) of those that robots can come too near to."""
    robots, count = motion.positions.shape[0], 0
    start = np.zeros(robots + 1, np.int64)
    obstacle = np.empty(robots * obstacles.shape[0], np.int64)
    for i in range(robots):
        for at in range(obstacles.shape[0]):
            gap = hypot(
                motion.positions[i, 0] - obstacles[at, 0], motion.positions[i, 1] - obstacles[at, 1]
            )
            if gap < distance + smoothing + motion.reach[i]:
                obstacle[count] = at
                count += 1
        start[i + 1] = count
    return start, obstacle[:count].copy()
