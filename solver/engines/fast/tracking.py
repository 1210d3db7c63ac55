"""Predicted uncertainty of the targets, with exact first and second derivatives.

Information form of the filter's covariance over the horizon (paper eq. 3, tracking term):

    P(k) = (P-(k)^-1 + sum_i I_i(k))^-1,   P-(k+1) = P(k) + Q(k+1).

The information of range and bearing from p = x - y, with rho^2 = |p|^2 + floor^2, is

    I(p) = a p p' + b (Jp)(Jp)',  a = rp exp(-rs rho) / rho^2,  b = bp exp(-bs rho) / rho^4.

A step's covariance hands on to all later ones; backwards the cost-to-go of P(k) is carried
as its gradient L (symmetric 2x2) and Hessian W (3x3 over xx, xy, yy), which gives the exact
cross-time Hessian of one robot's path at the price of a small constant per pair of steps.
"""

from math import exp, sqrt

from solver.arrays import FloatArray
from solver.engines.fast.jit import inlined, kernel, merged
from solver.engines.fast.layout import Table, Team
from solver.engines.fast.symmetric import Symmetric, inner, inverse, lifted, sandwich


@inlined
def strengths(setting: Table, squared: float, distance: float) -> tuple[float, float]:
    """Return a and b, which the information is made of."""
    inverted = 1.0 / squared
    fading = across = exp(-setting.range_shape * distance)
    if setting.bearing_shape != setting.range_shape:
        across = exp(-setting.bearing_shape * distance)
    across *= setting.bearing_peak * inverted
    return setting.range_peak * fading * inverted, across * inverted


@inlined
def information(setting: Table, x: float, y: float) -> Symmetric:
    """Return what a robot at (x, y) relative to the target learns of it."""
    squared = x * x + y * y + setting.floor
    along, across = strengths(setting, squared, sqrt(squared))
    return (
        along * x * x + across * y * y,
        (along - across) * x * y,
        along * y * y + across * x * x,
    )


@inlined
def trace(team: Team, at: int) -> float:
    """Return the sum over the horizon of tr P of the target of edge `at`, its robot on work.path.

    What the other robots contribute stands with the edge.
    """
    setting, path, edge = team.setting[0], team.work[0].path, team.edges[at]
    target, others = team.targets[edge.target], edge.others
    b0, b1, b2 = target.known[0], target.known[1], target.known[2]
    p0 = p1 = p2 = total = 0.0
    for k in range(setting.steps):
        if k > 0:
            b0, b1, b2 = inverse(
                p0 + target.growth[k, 0], p1 + target.growth[k, 1], p2 + target.growth[k, 2]
            )
        i0, i1, i2 = information(
            setting, path[k, 0] - target.means[k, 0], path[k, 1] - target.means[k, 1]
        )
        p0, p1, p2 = inverse(b0 + others[k, 0] + i0, b1 + others[k, 1] + i1, b2 + others[k, 2] + i2)
        total += p0 + p2
    return total


@inlined
def team_trace(team: Team, j: int) -> float:
    """Return the same for target j and the information that all robots' plans contribute."""
    target = team.targets[j]
    b0, b1, b2 = target.known[0], target.known[1], target.known[2]
    p0 = p1 = p2 = total = 0.0
    for k in range(team.setting[0].steps):
        if k > 0:
            b0, b1, b2 = inverse(
                p0 + target.growth[k, 0], p1 + target.growth[k, 1], p2 + target.growth[k, 2]
            )
        for entry in range(target.watch[0], target.watch[1]):
            known = team.edges[team.watch[entry]].information
            b0 += known[k, 0]
            b1 += known[k, 1]
            b2 += known[k, 2]
        p0, p1, p2 = inverse(b0, b1, b2)
        total += p0 + p2
    return total


@inlined
def refresh_information(team: Team, i: int) -> None:
    """Keep what robot i's plan tells of its targets."""
    setting, robot = team.setting[0], team.robots[i]
    for at in range(robot.sees[0], robot.sees[1]):
        edge = team.edges[at]
        target = team.targets[edge.target]
        for k in range(setting.steps):
            i0, i1, i2 = information(
                setting,
                robot.path[k, 0] - target.means[k, 0],
                robot.path[k, 1] - target.means[k, 1],
            )
            edge.information[k, 0] = i0
            edge.information[k, 1] = i1
            edge.information[k, 2] = i2


@merged
def gather_information(team: Team, i: int) -> None:
    """Note with robot i's edges what the other robots tell of its targets."""
    robot = team.robots[i]
    for at in range(robot.sees[0], robot.sees[1]):
        others = team.edges[at].others
        target = team.targets[team.edges[at].target]
        for k in range(team.setting[0].steps):
            s0 = s1 = s2 = 0.0
            for entry in range(target.watch[0], target.watch[1]):
                other = team.watch[entry]
                if other != at:
                    known = team.edges[other].information
                    s0 += known[k, 0]
                    s1 += known[k, 1]
                    s2 += known[k, 2]
            others[k, 0], others[k, 1], others[k, 2] = s0, s1, s2


@kernel
def add_tracking(team: Team, at: int) -> float:
    """Add the derivatives of edge `at`'s target by work.path; return its weighted cost."""
    total = _forward(team, at)
    _backward(team, False)
    return float(team.setting[0].tracking) * total


@kernel
def add_joint_tracking(team: Team, at: int, mate: int) -> None:
    """Add second derivatives by work.path (rows) and by a mate's path (columns).

    Edge `at` is that of the robot on work.path to a target that both see.
    """
    setting, work = team.setting[0], team.work[0]
    target = team.targets[team.edges[at].target]
    path, chain, twin = team.robots[mate].path, work.chain, work.twin
    _forward(team, at)
    for k in range(setting.steps):
        sensing(setting, path[k, 0] - target.means[k, 0], path[k, 1] - target.means[k, 1], twin, k)
        p0, p1, p2 = chain[k, 3], chain[k, 4], chain[k, 5]
        twin[k, 3], twin[k, 4], twin[k, 5] = p0, p1, p2
        for by in (10, 13):
            twin[k, by + 6], twin[k, by + 7], twin[k, by + 8] = sandwich(
                p0, p1, p2, twin[k, by], twin[k, by + 1], twin[k, by + 2]
            )
    _backward(team, True)


@kernel
def _forward(team: Team, at: int) -> float:
    """Fill the chain, return the sum of tr P.

    Columns: 0 P-^-1, 3 P, 6 A = P P-^-1 (four), 10 and 13 derivative of I by x and by y,
    16 and 19 P dI P likewise, 22, 25 and 28 second derivative of I by xx, xy and yy.
    """
    setting, edge = team.setting[0], team.edges[at]
    target, others = team.targets[edge.target], edge.others
    path, chain = team.work[0].path, team.work[0].chain
    b0, b1, b2 = target.known[0], target.known[1], target.known[2]
    p0 = p1 = p2 = total = 0.0
    for k in range(setting.steps):
        if k > 0:
            b0, b1, b2 = inverse(
                p0 + target.growth[k, 0], p1 + target.growth[k, 1], p2 + target.growth[k, 2]
            )
        i0, i1, i2 = sensing(
            setting, path[k, 0] - target.means[k, 0], path[k, 1] - target.means[k, 1], chain, k
        )
        p0, p1, p2 = inverse(b0 + others[k, 0] + i0, b1 + others[k, 1] + i1, b2 + others[k, 2] + i2)
        chain[k, 0], chain[k, 1], chain[k, 2] = b0, b1, b2
        chain[k, 3], chain[k, 4], chain[k, 5] = p0, p1, p2
        chain[k, 6] = p0 * b0 + p1 * b1
        chain[k, 7] = p0 * b1 + p1 * b2
        chain[k, 8] = p1 * b0 + p2 * b1
        chain[k, 9] = p1 * b1 + p2 * b2
        chain[k, 16], chain[k, 17], chain[k, 18] = sandwich(
            p0, p1, p2, chain[k, 10], chain[k, 11], chain[k, 12]
        )
        chain[k, 19], chain[k, 20], chain[k, 21] = sandwich(
            p0, p1, p2, chain[k, 13], chain[k, 14], chain[k, 15]
        )
        total += p0 + p2
    return total


@kernel
def sensing(setting: Table, x: float, y: float, chain: FloatArray, k: int) -> Symmetric:
    """Store the derivatives of the information of one robot, return it."""
    squared = x * x + y * y + setting.floor
    distance = sqrt(squared)
    a, b = strengths(setting, squared, distance)
    # Logarithmic derivatives by s = |p|^2, then the first and second by s.
    la = -0.5 * setting.range_shape / distance - 1.0 / squared
    lb = -0.5 * setting.bearing_shape / distance - 2.0 / squared
    cube = 0.25 / (distance * squared)
    a1 = a * la
    b1 = b * lb
    a2 = a1 * la + a * (setting.range_shape * cube + 1.0 / (squared * squared))
    b2 = b1 * lb + b * (setting.bearing_shape * cube + 2.0 / (squared * squared))
    xx, xy, yy = x * x, x * y, y * y
    ax, ay, bx, by = 2.0 * a1 * x, 2.0 * a1 * y, 2.0 * b1 * x, 2.0 * b1 * y
    axx, axy, ayy = 4.0 * a2 * xx + 2.0 * a1, 4.0 * a2 * xy, 4.0 * a2 * yy + 2.0 * a1
    bxx, bxy, byy = 4.0 * b2 * xx + 2.0 * b1, 4.0 * b2 * xy, 4.0 * b2 * yy + 2.0 * b1
    chain[k, 10] = ax * xx + 2.0 * a * x + bx * yy
    chain[k, 11] = (ax - bx) * xy + (a - b) * y
    chain[k, 12] = ax * yy + bx * xx + 2.0 * b * x
    chain[k, 13] = ay * xx + by * yy + 2.0 * b * y
    chain[k, 14] = (ay - by) * xy + (a - b) * x
    chain[k, 15] = ay * yy + 2.0 * a * y + by * xx
    # By x twice.
    chain[k, 22] = axx * xx + 4.0 * ax * x + 2.0 * a + bxx * yy
    chain[k, 23] = (axx - bxx) * xy + 2.0 * (ax - bx) * y
    chain[k, 24] = axx * yy + bxx * xx + 4.0 * bx * x + 2.0 * b
    # By x and y.
    chain[k, 25] = axy * xx + 2.0 * ay * x + bxy * yy + 2.0 * bx * y
    chain[k, 26] = (axy - bxy) * xy + (ax - bx) * x + (ay - by) * y + a - b
    chain[k, 27] = axy * yy + 2.0 * ax * y + bxy * xx + 2.0 * by * x
    # By y twice.
    chain[k, 28] = ayy * xx + byy * yy + 4.0 * by * y + 2.0 * b
    chain[k, 29] = (ayy - byy) * xy + 2.0 * (ay - by) * x
    chain[k, 30] = ayy * yy + 4.0 * ay * y + 2.0 * a + byy * xx
    return a * xx + b * yy, (a - b) * xy, a * yy + b * xx


@kernel
def _backward(team: Team, joint: bool) -> None:
    """Add the derivatives by work.path from the chain, or those by it and the twin's path."""
    weight, work = team.setting[0].tracking, team.work[0]
    chain, slope, bend = work.chain, work.slope, work.bend
    twin = work.twin if joint else work.chain
    l0, l1, l2 = weight, 0.0, weight
    w = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(team.setting[0].steps - 1, -1, -1):
        c, o = chain[k], twin[k]
        x0, x1, x2 = _answer(l0, l1, l2, w, c, 10)
        y0, y1, y2 = _answer(l0, l1, l2, w, c, 13)
        at = 2 * k
        _add_cross(o, at, at, x0, x1, x2, bend)
        _add_cross(o, at + 1, at, y0, y1, y2, bend)
        if joint:
            u0, u1, u2 = _answer(l0, l1, l2, w, o, 10)
            v0, v1, v2 = _answer(l0, l1, l2, w, o, 13)
        else:
            g0, g1, g2 = sandwich(c[3], c[4], c[5], l0, l1, l2)
            slope[k, 0] -= inner(g0, g1, g2, c[10], c[11], c[12])
            slope[k, 1] -= inner(g0, g1, g2, c[13], c[14], c[15])
            mixed = inner(g0, g1, g2, c[25], c[26], c[27])
            bend[at, at] -= inner(g0, g1, g2, c[22], c[23], c[24])
            bend[at, at + 1] -= mixed
            bend[at + 1, at] -= mixed
            bend[at + 1, at + 1] -= inner(g0, g1, g2, c[28], c[29], c[30])
            u0 = u1 = u2 = v0 = v1 = v2 = 0.0
        for m in range(k - 1, -1, -1):
            a, b, d, e = chain[m + 1, 6], chain[m + 1, 7], chain[m + 1, 8], chain[m + 1, 9]
            x0, x1, x2 = lifted(a, d, b, e, x0, x1, x2)
            y0, y1, y2 = lifted(a, d, b, e, y0, y1, y2)
            _add_cross(twin[m], at, 2 * m, x0, x1, x2, bend)
            _add_cross(twin[m], at + 1, 2 * m, y0, y1, y2, bend)
            if joint:
                u0, u1, u2 = lifted(a, d, b, e, u0, u1, u2)
                v0, v1, v2 = lifted(a, d, b, e, v0, v1, v2)
                _add_mirrored(chain[m], at, 2 * m, u0, u1, u2, bend)
                _add_mirrored(chain[m], at + 1, 2 * m, v0, v1, v2, bend)
            else:
                for row in range(at, at + 2):
                    for column in range(2 * m, 2 * m + 2):
                        bend[column, row] = bend[row, column]
        if k > 0:
            l0, l1, l2 = lifted(c[6], c[8], c[7], c[9], l0, l1, l2)
            w = _handed_on(w, c, l0, l1, l2)
            l0 += weight
            l2 += weight


@merged
def _answer(
    l0: float,
    l1: float,
    l2: float,
    w: tuple[float, float, float, float, float, float],
    c: FloatArray,
    at: int,
) -> Symmetric:
    """Return how the gradient by P dI P changes with the direction stored at `at`."""
    p0, p1, p2 = c[3], c[4], c[5]
    d0, d1, d2 = c[at], c[at + 1], c[at + 2]
    v0, v1, v2 = c[at + 6], c[at + 7], c[at + 8]
    # T = dI P L, of which T + T' counts.
    m00, m01 = d0 * p0 + d1 * p1, d0 * p1 + d1 * p2
    m10, m11 = d1 * p0 + d2 * p1, d1 * p1 + d2 * p2
    t00, t01 = m00 * l0 + m01 * l1, m00 * l1 + m01 * l2
    t10, t11 = m10 * l0 + m11 * l1, m10 * l1 + m11 * l2
    return (
        2.0 * t00 + w[0] * v0 + w[1] * v1 + w[2] * v2,
        t01 + t10 + 0.5 * (w[1] * v0 + w[3] * v1 + w[4] * v2),
        2.0 * t11 + w[2] * v0 + w[4] * v1 + w[5] * v2,
    )


@inlined
def _add_cross(
    c: FloatArray, row: int, column: int, x0: float, x1: float, x2: float, bend: FloatArray
) -> None:
    bend[row, column] += inner(x0, x1, x2, c[16], c[17], c[18])
    bend[row, column + 1] += inner(x0, x1, x2, c[19], c[20], c[21])


@inlined
def _add_mirrored(
    c: FloatArray, column: int, row: int, x0: float, x1: float, x2: float, bend: FloatArray
) -> None:
    bend[row, column] += inner(x0, x1, x2, c[16], c[17], c[18])
    bend[row + 1, column] += inner(x0, x1, x2, c[19], c[20], c[21])


@merged
def _handed_on(
    w: tuple[float, float, float, float, float, float],
    c: FloatArray,
    l0: float,
    l1: float,
    l2: float,
) -> tuple[float, float, float, float, float, float]:
    """Return the Hessian by the covariance one step earlier.

    `w` (00, 01, 02, 11, 12, 22) is that by P(k); L is A' L A already. Added is the second
    derivative of P by P-, which is -2 tr(L S C S) with C = P-^-1 - P-^-1 P P-^-1.
    """
    a, b, d, e = c[6], c[7], c[8], c[9]
    f0, f1, f2 = a * a, 2.0 * a * b, b * b
    g0, g1, g2 = a * d, a * e + b * d, b * e
    h0, h1, h2 = d * d, 2.0 * d * e, e * e
    m00 = w[0] * f0 + w[1] * g0 + w[2] * h0
    m01 = w[0] * f1 + w[1] * g1 + w[2] * h1
    m02 = w[0] * f2 + w[1] * g2 + w[2] * h2
    m10 = w[1] * f0 + w[3] * g0 + w[4] * h0
    m11 = w[1] * f1 + w[3] * g1 + w[4] * h1
    m12 = w[1] * f2 + w[3] * g2 + w[4] * h2
    m20 = w[2] * f0 + w[4] * g0 + w[5] * h0
    m21 = w[2] * f1 + w[4] * g1 + w[5] * h1
    m22 = w[2] * f2 + w[4] * g2 + w[5] * h2
    s0, s1, s2 = sandwich(c[0], c[1], c[2], c[3], c[4], c[5])
    c0, c1, c2 = c[0] - s0, c[1] - s1, c[2] - s2
    return (
        f0 * m00 + g0 * m10 + h0 * m20 - 2.0 * l0 * c0,
        f0 * m01 + g0 * m11 + h0 * m21 - 2.0 * (l0 * c1 + l1 * c0),
        f0 * m02 + g0 * m12 + h0 * m22 - 2.0 * l1 * c1,
        f1 * m01 + g1 * m11 + h1 * m21 - 2.0 * (l0 * c2 + 2.0 * l1 * c1 + l2 * c0),
        f1 * m02 + g1 * m12 + h1 * m22 - 2.0 * (l1 * c2 + l2 * c1),
        f2 * m02 + g2 * m12 + h2 * m22 - 2.0 * l2 * c2,
    )
