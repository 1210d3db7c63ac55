"""One robot's own problem: everything of the team's objective that its plan changes.

The other robots' plans are fixed. What depends on them alone is gathered once per visit;
what is left out is constant in the robot's own controls (2H,).
"""

from solver.arrays import FloatArray
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Sight, Team
from solver.engines.fast.limits import add_limits, limits_cost
from solver.engines.fast.rollout import pull_gradient, pull_hessian, roll
from solver.engines.fast.separation import add_separation, obstacles_cost, pairs_cost
from solver.engines.fast.spread import (
    add_jamming,
    add_rows,
    gather_rows,
    jamming_cost,
    refresh_clearance,
    rows_cost,
)
from solver.engines.fast.tracking import add_derivatives, information, team_trace, trace
from solver.engines.fast.zones import add_keep_out, keep_out_cost


@kernel
def gather(team: Team, i: int) -> int:
    """Collect what the other robots fix in robot i's problem, return the number of rows."""
    sight, others = team.sight, team.scratch.others
    steps = others.shape[1]
    for edge in range(sight.start[i], sight.start[i + 1]):
        slot = edge - sight.start[i]
        j = sight.target[edge]
        for k in range(steps):
            s0 = s1 = s2 = 0.0
            for entry in range(sight.watch_start[j], sight.watch_start[j + 1]):
                other = sight.watch[entry]
                if other != edge:
                    s0 += sight.information[other, k, 0]
                    s1 += sight.information[other, k, 1]
                    s2 += sight.information[other, k, 2]
            others[slot, k, 0], others[slot, k, 1], others[slot, k, 2] = s0, s1, s2
    if team.mates.row_start[i] == team.mates.row_start[i + 1]:
        return 0
    return gather_rows(
        team.jam, team.mates, team.plans, team.motion, i, team.smooth, team.scratch
    )


@kernel
def cost(team: Team, i: int, rows: int, u: FloatArray) -> float:
    """Return robot i's cost for the controls u (2H,)."""
    scratch, sight = team.scratch, team.sight
    path = scratch.path
    roll(team.motion, i, u, path, scratch.speeds)
    total = limits_cost(team.motion, i, u, path, scratch.speeds)
    for edge in range(sight.start[i], sight.start[i + 1]):
        slot = edge - sight.start[i]
        total += sight.weight * trace(sight, sight.target[edge], scratch.others, slot, path)
    total += keep_out_cost(team.keep, i, path, team.smooth.zone)
    total += jamming_cost(
        team.jam, team.mates, team.plans, i, path, team.smooth, scratch.mate_terms
    )
    total += pairs_cost(team.pairs, team.plans, i, path, team.smooth.zone)
    total += obstacles_cost(team.pairs, i, path, team.smooth.zone)
    if rows > 0:
        total += rows_cost(team.jam, team.plans, rows, path, team.smooth, scratch)
    return total


@kernel
def expand(team: Team, i: int, rows: int, u: FloatArray) -> float:
    """Fill gradient (2H,) and Hessian (2H, 2H) of robot i's cost at u, return the cost."""
    scratch, sight, motion = team.scratch, team.sight, team.motion
    path, slope, bend = scratch.path, scratch.slope, scratch.bend
    roll(motion, i, u, path, scratch.speeds)
    slope[:] = 0.0
    bend[:] = 0.0
    total = limits_cost(motion, i, u, path, scratch.speeds)
    add_limits(
        motion, i, path, scratch.speeds, slope, bend, scratch.speed_slope, scratch.speed_bend
    )
    for edge in range(sight.start[i], sight.start[i + 1]):
        total += add_derivatives(
            sight,
            sight.target[edge],
            scratch.others,
            edge - sight.start[i],
            path,
            scratch.chain,
            slope,
            bend,
        )
    total += add_keep_out(team.keep, i, path, team.smooth.zone, slope, bend)
    total += add_jamming(
        team.jam, team.mates, team.plans, i, path, team.smooth, scratch.mate_terms, slope, bend
    )
    total += add_separation(team.pairs, team.plans, i, path, team.smooth.zone, slope, bend)
    if rows > 0:
        total += add_rows(team.jam, team.plans, rows, path, team.smooth, scratch)
    for at in range(u.shape[0]):
        scratch.gradient[at] = 2.0 * motion.effort * u[at]
    pull_gradient(motion, slope, scratch.speed_slope, scratch.gradient)
    pull_hessian(motion, bend, scratch.speed_bend)
    for at in range(u.shape[0]):
        bend[at, at] += 2.0 * motion.effort
    return total


@kernel
def settle(team: Team, i: int, u: FloatArray) -> None:
    """Make u (2H,) robot i's plan, and refresh what the others read of it."""
    plans, scratch = team.plans, team.scratch
    roll(team.motion, i, u, scratch.path, scratch.speeds)
    for k in range(scratch.path.shape[0]):
        for axis in range(2):
            plans.controls[i, k, axis] = u[2 * k + axis]
            plans.paths[i, k, axis] = scratch.path[k, axis]
    _refresh_information(team.sight, i, scratch.path)
    refresh_clearance(team.jam, plans, i, team.smooth)


@kernel
def _refresh_information(sight: Sight, i: int, path: FloatArray) -> None:
    for edge in range(sight.start[i], sight.start[i + 1]):
        j = sight.target[edge]
        for k in range(path.shape[0]):
            i0, i1, i2 = information(
                path[k, 0] - sight.means[k, j, 0], path[k, 1] - sight.means[k, j, 1], sight.sensor
            )
            sight.information[edge, k, 0] = i0
            sight.information[edge, k, 1] = i1
            sight.information[edge, k, 2] = i2


@kernel
def team_cost(team: Team) -> float:
    """Return the objective of the whole team at its plans."""
    total = 0.0
    for j in range(team.sight.priors.shape[0]):
        total += team.sight.weight * team_trace(team.sight, j)
    path, u, smooth = team.scratch.path, team.scratch.u, team.smooth
    for i in range(team.plans.paths.shape[0]):
        for at in range(u.shape[0]):
            u[at] = team.plans.controls[i, at // 2, at % 2]
        roll(team.motion, i, u, path, team.scratch.speeds)
        total += limits_cost(team.motion, i, u, path, team.scratch.speeds)
        total += keep_out_cost(team.keep, i, path, smooth.zone)
        total += jamming_cost(
            team.jam, team.mates, team.plans, i, path, smooth, team.scratch.mate_terms
        )
        total += 0.5 * pairs_cost(team.pairs, team.plans, i, path, smooth.zone)
        total += obstacles_cost(team.pairs, i, path, smooth.zone)
    return total
