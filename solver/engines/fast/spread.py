"""Jamming: the keep-out of a communication zone grows with the spread of the team.

The spread seen by robot i is a soft maximum over its team mates,
D_i = tau log sum_l exp(d_il / tau). Moving robot i changes its own rows, and the rows of
every mate l that could be jammed: both are in robot i's problem, or sweeps over the robots
would not descend the team's objective.
"""

from math import exp, log

from solver.arrays import FloatArray
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Mates, Motion, Plans, Scratch, Smoothing, Zones
from solver.engines.fast.separation import apart
from solver.engines.fast.zones import add_hinge, clearance, clearance_derivatives

NEGLIGIBLE = 36.0
"""exp(-36) = 2e-16: mates nearer than the farthest by this many tau do not matter."""


@inlined
def _distances(
    mates: Mates, plans: Plans, i: int, k: int, x: float, y: float, e: float, terms: FloatArray
) -> float:
    """Fill terms[:, 0] with the distances of robot i's mates at step k, return the largest."""
    farthest = 0.0
    for edge in range(mates.start[i], mates.start[i + 1]):
        mate = mates.mate[edge]
        length = apart(x - plans.paths[mate, k, 0], y - plans.paths[mate, k, 1], e)
        terms[edge - mates.start[i], 0] = length
        farthest = max(farthest, length)
    return farthest


@kernel
def _soft_maximum(terms: FloatArray, count: int, farthest: float, tau: float) -> float:
    """Replace the distances in terms[:count, 0] by their weights, return the soft maximum."""
    total = 0.0
    for at in range(count):
        power = (terms[at, 0] - farthest) / tau
        terms[at, 0] = exp(power) if power > -NEGLIGIBLE else 0.0
        total += terms[at, 0]
    for at in range(count):
        terms[at, 0] /= total
    return farthest + tau * log(total)


@kernel
def jamming_cost(
    zones: Zones,
    mates: Mates,
    plans: Plans,
    i: int,
    path: FloatArray,
    smooth: Smoothing,
    terms: FloatArray,
) -> float:
    """Return the weighted squared hinges of robot i's own communication zones."""
    total = 0.0
    first, last = zones.start[i], zones.start[i + 1]
    count = mates.start[i + 1] - mates.start[i]
    if first == last:
        return total
    for k in range(path.shape[0]):
        x, y = path[k, 0], path[k, 1]
        farthest = _distances(mates, plans, i, k, x, y, smooth.zone, terms)
        spread = -1.0
        for edge in range(first, last):
            c = zones.zone[edge]
            gap = clearance(zones, c, x, y, smooth.zone)
            margin = zones.margins[c]
            if count > 0 and gap < margin * (farthest + smooth.mates * log(count)):
                if spread < 0.0:
                    spread = _soft_maximum(terms, count, farthest, smooth.mates)
                gap -= margin * spread
            if gap < 0.0:
                total += zones.weights[c] * gap * gap
    return total


@kernel
def add_jamming(
    zones: Zones,
    mates: Mates,
    plans: Plans,
    i: int,
    path: FloatArray,
    smooth: Smoothing,
    terms: FloatArray,
    slope: FloatArray,
    bend: FloatArray,
) -> float:
    """Add the derivatives of the same by the path, return it."""
    total = 0.0
    first, last = zones.start[i], zones.start[i + 1]
    count = mates.start[i + 1] - mates.start[i]
    if first == last:
        return total
    for k in range(path.shape[0]):
        x, y = path[k, 0], path[k, 1]
        farthest = _distances(mates, plans, i, k, x, y, smooth.zone, terms)
        spread = -1.0
        sx = sy = sxx = sxy = syy = 0.0
        for edge in range(first, last):
            c = zones.zone[edge]
            margin = zones.margins[c]
            gap, gx, gy, xx, xy, yy = clearance_derivatives(zones, c, x, y, smooth.zone)
            if count > 0 and gap < margin * (farthest + smooth.mates * log(count)):
                if spread < 0.0:
                    spread = _soft_maximum(terms, count, farthest, smooth.mates)
                    sx, sy, sxx, sxy, syy = _spread_derivatives(
                        mates, plans, i, k, x, y, smooth, terms
                    )
                gap -= margin * spread
                gx -= margin * sx
                gy -= margin * sy
                xx -= margin * sxx
                xy -= margin * sxy
                yy -= margin * syy
            if gap < 0.0:
                total += zones.weights[c] * gap * gap
                add_hinge(2.0 * zones.weights[c], gap, gx, gy, xx, xy, yy, k, slope, bend)
    return total


@inlined
def _spread_derivatives(
    mates: Mates,
    plans: Plans,
    i: int,
    k: int,
    x: float,
    y: float,
    smooth: Smoothing,
    terms: FloatArray,
) -> tuple[float, float, float, float, float]:
    """Return gradient and Hessian (xx, xy, yy) of the soft maximum with weights terms[:, 0]."""
    gx = gy = xx = xy = yy = 0.0
    sharp = 1.0 / smooth.mates
    for edge in range(mates.start[i], mates.start[i + 1]):
        weight = terms[edge - mates.start[i], 0]
        if weight == 0.0:
            continue
        mate = mates.mate[edge]
        dx = x - plans.paths[mate, k, 0]
        dy = y - plans.paths[mate, k, 1]
        length = apart(dx, dy, smooth.zone) + smooth.zone
        dx /= length
        dy /= length
        gx += weight * dx
        gy += weight * dy
        xx += weight * ((1.0 - dx * dx) / length + sharp * dx * dx)
        xy += weight * (sharp - 1.0 / length) * dx * dy
        yy += weight * ((1.0 - dy * dy) / length + sharp * dy * dy)
    return gx, gy, xx - sharp * gx * gx, xy - sharp * gx * gy, yy - sharp * gy * gy


@kernel
def refresh_clearance(zones: Zones, plans: Plans, i: int, smooth: Smoothing) -> None:
    """Keep the clearances of robot i's plan that its mates' problems read."""
    for edge in range(zones.start[i], zones.start[i + 1]):
        c = zones.zone[edge]
        for k in range(plans.paths.shape[1]):
            zones.clearance[edge, k] = clearance(
                zones, c, plans.paths[i, k, 0], plans.paths[i, k, 1], smooth.zone
            )


@kernel
def gather_rows(
    zones: Zones,
    mates: Mates,
    plans: Plans,
    motion: Motion,
    i: int,
    smooth: Smoothing,
    scratch: Scratch,
) -> int:
    """List the mates' jamming rows (l, k) that robot i can change, return how many.

    The rest of each row's soft maximum is computed once, from the other mates themselves:
    taking robot i's share out of a stored sum would cancel where it is the farthest.
    """
    count = 0
    for entry in range(mates.row_start[i], mates.row_start[i + 1]):
        mate = mates.row[entry]
        size = mates.start[mate + 1] - mates.start[mate]
        slack = smooth.mates * log(size)
        for k in range(plans.paths.shape[1]):
            near = apart(
                plans.paths[mate, k, 0] - motion.positions[i, 0],
                plans.paths[mate, k, 1] - motion.positions[i, 1],
                smooth.zone,
            )
            most = near + motion.reach[i] + smooth.zone
            rest = _rest(mates, plans, mate, i, k, smooth, scratch)
            if most < rest - NEGLIGIBLE * smooth.mates:
                continue
            if not _can_bind(zones, mate, k, max(most, rest) + slack):
                continue
            scratch.row_robot[count] = mate
            scratch.row_step[count] = k
            scratch.row_terms[count, 0] = rest
            scratch.row_terms[count, 1] = _rest_sum(size - 1, rest, smooth.mates, scratch)
            count += 1
    return count


@inlined
def _rest(
    mates: Mates, plans: Plans, mate: int, i: int, k: int, smooth: Smoothing, scratch: Scratch
) -> float:
    """Return the mate's largest distance to others than robot i; fill mate_terms[:, 1]."""
    x, y = plans.paths[mate, k, 0], plans.paths[mate, k, 1]
    farthest = 0.0
    at = 0
    for edge in range(mates.start[mate], mates.start[mate + 1]):
        other = mates.mate[edge]
        if other != i:
            length = apart(x - plans.paths[other, k, 0], y - plans.paths[other, k, 1], smooth.zone)
            scratch.mate_terms[at, 1] = length
            farthest = max(farthest, length)
            at += 1
    return farthest


@inlined
def _rest_sum(count: int, rest: float, tau: float, scratch: Scratch) -> float:
    total = 0.0
    for at in range(count):
        power = (scratch.mate_terms[at, 1] - rest) / tau
        if power > -NEGLIGIBLE:
            total += exp(power)
    return total


@inlined
def _can_bind(zones: Zones, mate: int, k: int, spread: float) -> bool:
    """Return whether any of the mate's zones binds at step k for this spread."""
    for edge in range(zones.start[mate], zones.start[mate + 1]):
        if zones.clearance[edge, k] < zones.margins[zones.zone[edge]] * spread:
            return True
    return False


@inlined
def _row_spread(rest: float, rest_sum: float, length: float, tau: float) -> tuple[float, float]:
    """Return the mate's soft maximum and robot i's weight in it."""
    if rest_sum == 0.0:
        return length, 1.0
    farthest = max(rest, length)
    mine = exp((length - farthest) / tau)
    total = rest_sum * exp((rest - farthest) / tau) + mine
    return farthest + tau * log(total), mine / total


@kernel
def rows_cost(
    zones: Zones, plans: Plans, count: int, path: FloatArray, smooth: Smoothing, scratch: Scratch
) -> float:
    """Return the weighted squared hinges of the mates' rows in the list."""
    total = 0.0
    for row in range(count):
        mate, k = scratch.row_robot[row], scratch.row_step[row]
        length = apart(
            path[k, 0] - plans.paths[mate, k, 0], path[k, 1] - plans.paths[mate, k, 1], smooth.zone
        )
        spread, _ = _row_spread(
            scratch.row_terms[row, 0], scratch.row_terms[row, 1], length, smooth.mates
        )
        for edge in range(zones.start[mate], zones.start[mate + 1]):
            c = zones.zone[edge]
            gap = zones.clearance[edge, k] - zones.margins[c] * spread
            if gap < 0.0:
                total += zones.weights[c] * gap * gap
    return total


@kernel
def add_rows(
    zones: Zones,
    plans: Plans,
    count: int,
    path: FloatArray,
    smooth: Smoothing,
    scratch: Scratch,
) -> float:
    """Add the derivatives of the same by robot i's path, return it."""
    total = 0.0
    sharp = 1.0 / smooth.mates
    for row in range(count):
        mate, k = scratch.row_robot[row], scratch.row_step[row]
        dx = path[k, 0] - plans.paths[mate, k, 0]
        dy = path[k, 1] - plans.paths[mate, k, 1]
        length = apart(dx, dy, smooth.zone) + smooth.zone
        dx /= length
        dy /= length
        spread, share = _row_spread(
            scratch.row_terms[row, 0],
            scratch.row_terms[row, 1],
            length - smooth.zone,
            smooth.mates,
        )
        along = share * (1.0 - share) * sharp
        across = share / length
        for edge in range(zones.start[mate], zones.start[mate + 1]):
            c = zones.zone[edge]
            margin = zones.margins[c]
            gap = zones.clearance[edge, k] - margin * spread
            if gap < 0.0:
                total += zones.weights[c] * gap * gap
                add_hinge(
                    2.0 * zones.weights[c],
                    gap,
                    -margin * share * dx,
                    -margin * share * dy,
                    -margin * (across * (1.0 - dx * dx) + along * dx * dx),
                    -margin * (along - across) * dx * dy,
                    -margin * (across * (1.0 - dy * dy) + along * dy * dy),
                    k,
                    scratch.slope,
                    scratch.bend,
                )
    return total
