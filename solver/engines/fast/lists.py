"""Sparse lists of what can matter within the horizon: everything beyond reach is left out.

Each bound below is safe: an entry left out contributes nothing (or, for information and soft
maxima, nothing that double precision could show) wherever the robots can get.
"""

from math import exp, hypot, log, sqrt

import numpy as np

from solver.arrays import BoolArray, FloatArray, IntArray
from solver.engines.fast.jit import kernel, merged
from solver.engines.fast.layout import EDGE, JAM, Table
from solver.engines.fast.spread import NEGLIGIBLE

_NO_INFORMATION = 1e-11
"""Relative change of a target's covariance that is left out."""


@merged
def sight_edges(setting: Table, robots: Table, targets: Table, seen: IntArray) -> Table:
    """Return the edges (E,) of the flat indices `seen` into (M, N); fill the rows `sees`."""
    edges = np.empty(seen.shape[0], EDGE)
    count, at = 0, 0
    for i in range(robots.shape[0]):
        robots[i].sees[0] = count
        while at < seen.shape[0] and seen[at] < (i + 1) * targets.shape[0]:
            j = seen[at] - i * targets.shape[0]
            if _can_tell(setting, robots[i], targets[j]):
                edges[count].robot = i
                edges[count].target = j
                count += 1
            at += 1
        robots[i].sees[1] = count
    return edges[:count]


@merged
def _can_tell(setting: Table, robot: Table, target: Table) -> bool:
    """Return whether the robot could learn anything of the target within the horizon."""
    variance = target.prior[0] + target.prior[2]
    nearest = np.inf
    for k in range(setting.steps):
        if k > 0:
            variance += target.growth[k, 0] + target.growth[k, 2]
        length = hypot(
            target.means[k, 0] - robot.position[0], target.means[k, 1] - robot.position[1]
        )
        if length != length:
            return True  # not a number: the objective must show it
        nearest = min(nearest, length)
    nearest = max(nearest - robot.reach, 0.0)
    most = setting.range_peak * exp(-setting.range_shape * nearest)
    most += (
        setting.bearing_peak
        * exp(-setting.bearing_shape * nearest)
        / (nearest * nearest + setting.floor)
    )
    return not most * variance <= _NO_INFORMATION


@merged
def watch_list(targets: Table, edges: Table) -> IntArray:
    """Return the edges by target; fill the rows `watch`."""
    for at in range(edges.shape[0]):
        targets[edges[at].target].watch[1] += 1
    count = 0
    for j in range(targets.shape[0]):
        size = targets[j].watch[1]
        targets[j].watch[0] = targets[j].watch[1] = count
        count += size
    watch = np.empty(edges.shape[0], np.int64)
    for at in range(edges.shape[0]):
        target = targets[edges[at].target]
        watch[target.watch[1]] = at
        target.watch[1] += 1
    return watch


@kernel
def _can_enter(setting: Table, robot: Table, zone: Table, spread: float) -> bool:
    """Return whether the zone could bind; `spread` multiplies its margin."""
    xx, xy, yy = zone.covariance[0], zone.covariance[1], zone.covariance[2]
    widest = 0.5 * (xx + yy) + hypot(0.5 * (xx - yy), xy)
    radius = max(zone.quantile, 0.0) * sqrt(max(widest, 0.0)) + zone.margin * spread
    distance = hypot(zone.centre[0] - robot.position[0], zone.centre[1] - robot.position[1])
    return bool(zone.weight > 0.0 and distance < radius + robot.reach + setting.smooth)


@merged
def keep_list(setting: Table, robots: Table, zones: Table, known: BoolArray) -> IntArray:
    """Return the sensing zones that can bind; fill the rows `keeps`."""
    keeps = np.empty(robots.shape[0] * zones.shape[0], np.int64)
    count = 0
    for i in range(robots.shape[0]):
        robots[i].keeps[0] = count
        for s in range(zones.shape[0]):
            if known[i, s] and _can_enter(setting, robots[i], zones[s], 1.0):
                keeps[count] = s
                count += 1
        robots[i].keeps[1] = count
    return keeps[:count]


@merged
def jam_list(setting: Table, robots: Table, zones: Table, known: BoolArray) -> Table:
    """Return the communication zones (JAM) that can bind; fill the rows `jams`."""
    jams = np.empty(robots.shape[0] * zones.shape[0], JAM)
    count = 0
    for i in range(robots.shape[0]):
        robots[i].jams[0] = count
        spread = -1.0
        for s in range(zones.shape[0]):
            if known[i, s]:
                if spread < 0.0:
                    spread = _widest_spread(setting, robots, i)
                if _can_enter(setting, robots[i], zones[s], spread):
                    jams[count].zone = s
                    count += 1
        robots[i].jams[1] = count
    return jams[:count]


@merged
def _widest_spread(setting: Table, robots: Table, i: int) -> float:
    """Return an upper bound of the spread robot i can see within the horizon."""
    farthest = 0.0
    for mate in range(robots.shape[0]):
        if mate != i:
            farthest = max(farthest, _between(robots, i, mate) + robots[mate].reach)
    if robots.shape[0] < 2:
        return 0.0
    return farthest + float(robots[i].reach + setting.blend * log(robots.shape[0]))


@kernel
def _between(robots: Table, i: int, mate: int) -> float:
    """Return the distance of two robots now."""
    return hypot(
        robots[i].position[0] - robots[mate].position[0],
        robots[i].position[1] - robots[mate].position[1],
    )


@merged
def mate_list(setting: Table, robots: Table) -> IntArray:
    """Return, for robots that can be jammed, the mates that can be their farthest.

    Fills the rows `mates`.
    """
    count = robots.shape[0]
    jammed = 0
    for i in range(count):
        jammed += robots[i].jams[1] > robots[i].jams[0]
    mates = np.empty(jammed * count, np.int64)
    total = 0
    for i in range(count):
        robots[i].mates[0] = total
        if robots[i].jams[1] > robots[i].jams[0]:
            least = 0.0
            for mate in range(count):
                if mate != i:
                    reach = robots[i].reach + robots[mate].reach
                    least = max(least, _between(robots, i, mate) - reach)
            least -= NEGLIGIBLE * setting.blend + setting.smooth
            for mate in range(count):
                reach = robots[i].reach + robots[mate].reach
                if mate != i and _between(robots, i, mate) + reach >= least:
                    mates[total] = mate
                    total += 1
        robots[i].mates[1] = total
    return mates[:total]


@merged
def row_list(robots: Table, mates: IntArray) -> IntArray:
    """Return the list of mates transposed; fill the rows `rows`."""
    for at in range(mates.shape[0]):
        robots[mates[at]].rows[1] += 1
    total = 0
    for i in range(robots.shape[0]):
        size = robots[i].rows[1]
        robots[i].rows[0] = robots[i].rows[1] = total
        total += size
    rows = np.empty(total, np.int64)
    for i in range(robots.shape[0]):
        for at in range(robots[i].mates[0], robots[i].mates[1]):
            mate = robots[mates[at]]
            rows[mate.rows[1]] = i
            mate.rows[1] += 1
    return rows


@merged
def near_list(setting: Table, robots: Table, order: IntArray) -> IntArray:
    """Return the mates that can come too near; fill the rows `near`.

    `order` (M,) sorts the robots by x, so that far ones never meet.
    """
    total = _near_pairs(setting, robots, order, np.empty(0, np.int64))
    count = 0
    for i in range(robots.shape[0]):
        size = robots[i].near[1]
        robots[i].near[0] = robots[i].near[1] = count
        count += size
    near = np.empty(total, np.int64)
    _near_pairs(setting, robots, order, near)
    return near


@kernel
def _near_pairs(setting: Table, robots: Table, order: IntArray, near: IntArray) -> int:
    """Move the ends of the rows `near` by each pair found; store it if `near` has room."""
    farthest = 0.0
    for i in range(robots.shape[0]):
        farthest = max(farthest, robots[i].reach)
    limit = setting.distance + setting.smooth
    total = 0
    for first in range(order.shape[0]):
        robot = robots[order[first]]
        for second in range(first + 1, order.shape[0]):
            mate = robots[order[second]]
            if mate.position[0] - robot.position[0] > limit + robot.reach + farthest:
                break
            distance = _between(robots, order[first], order[second])
            if distance < limit + robot.reach + mate.reach:
                if near.shape[0] > 0:
                    near[robot.near[1]] = order[second]
                    near[mate.near[1]] = order[first]
                robot.near[1] += 1
                mate.near[1] += 1
                total += 2
    return total


@merged
def disc_list(setting: Table, robots: Table, obstacles: FloatArray) -> IntArray:
    """Return the obstacles that robots can come too near to; fill the rows `discs`."""
    discs = np.empty(robots.shape[0] * obstacles.shape[0], np.int64)
    count = 0
    for i in range(robots.shape[0]):
        robot = robots[i]
        robot.discs[0] = count
        for at in range(obstacles.shape[0]):
            gap = hypot(obstacles[at, 0] - robot.position[0], obstacles[at, 1] - robot.position[1])
            if gap < setting.distance + setting.smooth + robot.reach:
                discs[count] = at
                count += 1
        robot.discs[1] = count
    return discs[:count]
