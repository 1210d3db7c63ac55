"""Tracking one step ahead: the derivatives of `tracking.py` where there is no horizon.

What is left is tr P of each target, P = (P-^-1 + sum_i I_i)^-1. Its derivatives are

    d tr P = -tr(P^2 dI),   dd tr P = 2 tr(P dI P dI' P) - tr(P^2 ddI),

where dI and dI' may belong to two robots. The first derivatives of the information stay with the
edges and P with the targets, so that the blocks between two robots cost next to nothing.
"""

from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Team
from solver.engines.fast.symmetric import Symmetric, inner, inverse
from solver.engines.fast.tracking import sensing


@inlined
def _response(
    p0: float, p1: float, p2: float, weight: float, d0: float, d1: float, d2: float
) -> Symmetric:
    """Return X = P^2 D P and its mirror image, weighted: d tr P by D and E is tr(X E)."""
    s0, s1, s2 = weight * (p0 * p0 + p1 * p1), weight * p1 * (p0 + p2), weight * (p1 * p1 + p2 * p2)
    m00, m01 = s0 * d0 + s1 * d1, s0 * d1 + s1 * d2
    m10, m11 = s1 * d0 + s2 * d1, s1 * d1 + s2 * d2
    return (
        2.0 * (m00 * p0 + m01 * p1),
        m00 * p1 + m01 * p2 + m10 * p0 + m11 * p1,
        2.0 * (m10 * p1 + m11 * p2),
    )


@inlined
def add_glimpse(team: Team, at: int) -> float:
    """Add the derivatives of edge `at`'s target by work.path; return its weighted cost."""
    setting, work, edge = team.setting[0], team.work[0], team.edges[at]
    target, c, bend = team.targets[edge.target], work.chain[0], work.bend
    known, others, means, weight = target.known, edge.others, target.means, setting.tracking
    i0, i1, i2 = sensing(
        setting, work.path[0, 0] - means[0, 0], work.path[0, 1] - means[0, 1], work.chain, 0
    )
    p0, p1, p2 = inverse(
        known[0] + others[0, 0] + i0, known[1] + others[0, 1] + i1, known[2] + others[0, 2] + i2
    )
    target.posterior[0], target.posterior[1], target.posterior[2] = p0, p1, p2
    for entry in range(6):
        edge.slope[entry] = c[10 + entry]
    s0, s1, s2 = weight * (p0 * p0 + p1 * p1), weight * p1 * (p0 + p2), weight * (p1 * p1 + p2 * p2)
    work.slope[0, 0] -= inner(s0, s1, s2, c[10], c[11], c[12])
    work.slope[0, 1] -= inner(s0, s1, s2, c[13], c[14], c[15])
    x0, x1, x2 = _response(p0, p1, p2, weight, c[10], c[11], c[12])
    y0, y1, y2 = _response(p0, p1, p2, weight, c[13], c[14], c[15])
    mixed = inner(x0, x1, x2, c[13], c[14], c[15]) - inner(s0, s1, s2, c[25], c[26], c[27])
    bend[0, 0] += inner(x0, x1, x2, c[10], c[11], c[12]) - inner(s0, s1, s2, c[22], c[23], c[24])
    bend[0, 1] += mixed
    bend[1, 0] += mixed
    bend[1, 1] += inner(y0, y1, y2, c[13], c[14], c[15]) - inner(s0, s1, s2, c[28], c[29], c[30])
    return float(weight * (p0 + p2))


@kernel
def add_joint_glimpse(team: Team, at: int, other: int) -> None:
    """Add second derivatives by the paths of edge `at`'s robot (rows) and of `other`'s (columns).

    Both edges lead to one target, and `add_glimpse` has seen both since the plans last changed.
    """
    bend, weight = team.work[0].bend, team.setting[0].tracking
    own, its = team.edges[at].slope, team.edges[other].slope
    posterior = team.targets[team.edges[at].target].posterior
    p0, p1, p2 = posterior[0], posterior[1], posterior[2]
    for axis in range(2):
        by = 3 * axis
        x0, x1, x2 = _response(p0, p1, p2, weight, own[by], own[by + 1], own[by + 2])
        bend[axis, 0] += inner(x0, x1, x2, its[0], its[1], its[2])
        bend[axis, 1] += inner(x0, x1, x2, its[3], its[4], its[5])
