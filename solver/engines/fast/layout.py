"""What the kernels hand to each other: arrays grouped by noun.

Indices: i, l robots (M); j targets (N); k steps (H); e edges of sparse lists, which are
stored row by row: the entries of row i are `start[i]` to `start[i + 1]`. Symmetric 2x2
matrices are three numbers. Frame ENU, metres, seconds.
"""

from typing import NamedTuple

from solver.arrays import FloatArray, IntArray


class Motion(NamedTuple):
    """How robots move, and their limits."""

    step: float
    double: bool
    positions: FloatArray
    """(M, 2) now."""

    velocities: FloatArray
    """(M, 2) now."""

    lower: FloatArray
    upper: FloatArray
    """(M, 2H) hard box of the controls, that of the first step narrowed."""

    reach: FloatArray
    """(M,) how far a robot can get from its position within the horizon, metres."""

    speed: FloatArray
    """(M,) per-axis speed limit."""

    field: FloatArray
    """(4,) lower x, lower y, upper x, upper y."""

    field_weight: float
    effort: float
    """w2."""


class Plans(NamedTuple):
    """The plan of every robot as it stands."""

    controls: FloatArray
    """(M, H, 2)."""

    paths: FloatArray
    """(M, H, 2) positions at steps 1..H."""


class Sight(NamedTuple):
    """Who sees which target, and what is known of the targets."""

    start: IntArray
    """(M + 1,)."""

    target: IntArray
    """(E,) target of each edge."""

    watch_start: IntArray
    """(N + 1,)."""

    watch: IntArray
    """(E,) the edges of each target."""

    robot: IntArray
    """(E,) robot of each edge."""

    information: FloatArray
    """(E, H, 3) what each edge contributes now."""

    means: FloatArray
    """(H, N, 2)."""

    priors: FloatArray
    """(N, 3) eigenvalues clamped."""

    growth: FloatArray
    """(H, N, 2, 2)."""

    sensor: FloatArray
    """(5,) range peak and shape, bearing peak and shape, squared floor of the distance."""

    weight: float
    """w1."""


class Zones(NamedTuple):
    """Zones of one kind, and which of them each robot could enter within the horizon."""

    start: IntArray
    """(M + 1,)."""

    zone: IntArray
    """(E,) zone of each edge."""

    centres: FloatArray
    """(K, 2)."""

    covariances: FloatArray
    """(K, 2, 2)."""

    margins: FloatArray
    quantiles: FloatArray
    weights: FloatArray
    """(K,) weight of the squared hinge, severity included."""

    clearance: FloatArray
    """(E, H) clearance of the plan without the margin (communication only)."""


class Mates(NamedTuple):
    """Which team mates can be the farthest from a robot that can be jammed."""

    start: IntArray
    """(M + 1,)."""

    mate: IntArray
    """(E,)."""

    row_start: IntArray
    """(M + 1,)."""

    row: IntArray
    """(E,) robots l in whose list the robot stands."""


class Pairs(NamedTuple):
    """Who can come too near to whom."""

    start: IntArray
    """(M + 1,)."""

    mate: IntArray
    """(E,) each pair stands in both rows."""

    obstacle_start: IntArray
    """(M + 1,)."""

    obstacle: IntArray
    """(E,)."""

    obstacles: FloatArray
    """(K, 2)."""

    distance: float
    """Separation wanted, metres."""

    weight: float


class Smoothing(NamedTuple):
    """Lengths that round the corners of the objective, metres."""

    zone: float
    mates: float


class Scratch(NamedTuple):
    """Work space for one robot's own problem, n = 2H unknowns ordered (step, axis)."""

    u: FloatArray
    trial: FloatArray
    fresh: FloatArray
    direction: FloatArray
    gradient: FloatArray
    """(n,) each; the gradient by controls."""

    path: FloatArray
    """(H, 2) positions of `u` or of `trial`, whichever was evaluated last."""

    speeds: FloatArray
    """(H, 2) velocities likewise."""

    slope: FloatArray
    """(H, 2) gradient by positions."""

    speed_slope: FloatArray
    speed_bend: FloatArray
    """(H, 2) first and second derivatives by velocities."""

    bend: FloatArray
    """(n, n) Hessian, by positions first, then by controls."""

    factor: FloatArray
    """(n, n)."""

    basis: FloatArray
    """(n, n)."""

    free: IntArray
    """(n,)."""

    vector: FloatArray
    work: FloatArray
    """(n,) each."""

    chain: FloatArray
    """(H, 31) one target's covariances along the horizon."""

    others: FloatArray
    """(D, H, 3) information of the other robots on each of the robot's targets."""

    mate_terms: FloatArray
    """(M, 4)."""

    row_robot: IntArray
    row_step: IntArray
    """(R,) jamming rows of team mates in which the robot can matter."""

    row_terms: FloatArray
    """(R, 2) the largest distance to the other mates, and their sum of exponentials."""

    timespec: IntArray


class Team(NamedTuple):
    """All of it."""

    motion: Motion
    plans: Plans
    sight: Sight
    keep: Zones
    """Sensing zones."""

    jam: Zones
    """Communication zones."""

    mates: Mates
    pairs: Pairs
    smooth: Smoothing
    scratch: Scratch
