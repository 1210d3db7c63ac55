"""What the kernels hand to each other: tables of records, one per noun.

A record keeps together what is read together, and a table is one argument whatever its
number of fields, which keeps calls cheap and compiling short. Lists are rows of flat index
arrays: a robot's field `(first, last)` says which part of the list is its own. Horizons go
to MAX_STEPS; the unknowns of a robot are ordered (step, axis). Symmetric 2x2 matrices are
three numbers (xx, xy, yy). Frame ENU, metres, seconds.

A record taken out of a table does not keep the table alive. Kernels get theirs from a caller
that holds the team; the outermost function uses the team once more after its last record.
"""

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from solver.arrays import FloatArray, IntArray

MAX_STEPS = 10
MAX_SIZE = 2 * MAX_STEPS
MAX_JOINT = 48
"""Most unknowns of a team whose robots are improved together as well (`joint.py`): the work
grows with their cube, and at 80 it costs as much as all sweeps."""

CHAIN = 31
"""Columns of the scratch of `tracking.py`."""

CHOICES = 4
"""Probe starts that are followed up per round."""

COARSE = 3
"""Points per axis of the coarse grid of constant plans."""

Table: TypeAlias = Any
"""A structured array: its elements have the fields of one of the types below."""

_PER_STEP = (MAX_STEPS, 2)
_VECTOR = (MAX_SIZE,)
_JOINT = (MAX_JOINT,)
_MATRIX = (MAX_JOINT, MAX_JOINT)

SETTING = np.dtype(
    [
        ("steps", "i8"),
        ("step", "f8"),  # seconds
        ("double", "?"),  # double integrator
        ("field", "f8", (4,)),  # lower x, lower y, upper x, upper y
        ("field_weight", "f8"),
        ("effort", "f8"),  # w2
        ("tracking", "f8"),  # w1
        ("range_peak", "f8"),
        ("range_shape", "f8"),
        ("bearing_peak", "f8"),
        ("bearing_shape", "f8"),
        ("floor", "f8"),  # squared floor of the distance to a target
        ("distance", "f8"),  # separation wanted
        ("separation", "f8"),  # its weight
        ("smooth", "f8"),  # length that rounds the corners of zones and distances
        ("blend", "f8"),  # length that blends the soft maximum over team mates
    ],
    align=True,
)

ROBOT = np.dtype(
    [
        ("position", "f8", (2,)),
        ("velocity", "f8", (2,)),
        ("reach", "f8"),  # how far it gets within the horizon
        ("speed", "f8"),  # per-axis limit
        ("lower", "f8", _VECTOR),  # hard box of the controls, narrowed for the first step
        ("upper", "f8", _VECTOR),
        ("plan", "f8", _VECTOR),  # controls as they stand
        ("path", "f8", _PER_STEP),  # where they lead
        ("shift", "f8", _PER_STEP),  # what a step would change of that, see `guards.py`
        ("sees", "i8", (2,)),  # rows of the lists named alike
        ("keeps", "i8", (2,)),
        ("jams", "i8", (2,)),
        ("mates", "i8", (2,)),
        ("rows", "i8", (2,)),
        ("near", "i8", (2,)),
        ("discs", "i8", (2,)),
        ("stale", "?"),  # not converged, or its problem has changed since
        ("curious", "?"),  # its problem has changed since it looked at fresh starts
        ("jumped", "?"),  # a fresh start took its plan's place
        ("effort", "i8"),  # spent on fresh starts, see `probes.py`
        ("replan", "?"),  # which takes the plan's place without hysteresis
        ("taken", "i8"),  # Newton steps
    ],
    align=True,
)

TARGET = np.dtype(
    [
        ("means", "f8", _PER_STEP),
        ("prior", "f8", (3,)),  # eigenvalues clamped
        ("known", "f8", (3,)),  # its inverse
        ("growth", "f8", (MAX_STEPS, 3)),
        ("posterior", "f8", (3,)),  # at one step, see `glimpse.py`
        ("watch", "i8", (2,)),  # row of the list of edges that see it
    ],
    align=True,
)

EDGE = np.dtype(
    [
        ("robot", "i8"),
        ("target", "i8"),
        ("information", "f8", (MAX_STEPS, 3)),  # what the robot's plan contributes
        ("others", "f8", (MAX_STEPS, 3)),  # what the others' do, while the robot is at work
        ("slope", "f8", (6,)),  # derivatives by x and by y at one step, see `glimpse.py`
    ],
    align=True,
)

ZONE = np.dtype(
    [
        ("centre", "f8", (2,)),
        ("covariance", "f8", (3,)),
        ("margin", "f8"),  # metres, or factor on the spread of the team
        ("quantile", "f8"),
        ("weight", "f8"),  # of the squared hinge, severity included
    ],
    align=True,
)

JAM = np.dtype(
    [
        ("zone", "i8"),
        ("clearance", "f8", (MAX_STEPS,)),  # of the robot's plan, spread not yet subtracted
    ],
    align=True,
)

ROW = np.dtype(
    [
        ("robot", "i8"),  # the team mate whose row it is
        ("step", "i8"),
        ("rest", "f8"),  # its largest distance to others
        ("sum", "f8"),  # their exponentials relative to that
    ],
    align=True,
)

WORK = np.dtype(
    [
        ("u", "f8", _JOINT),
        ("lower", "f8", _JOINT),  # hard box of whoever is at work
        ("upper", "f8", _JOINT),
        ("trial", "f8", _JOINT),
        ("best", "f8", _VECTOR),
        ("base", "f8", _VECTOR),  # the plan that probe starts depart from
        ("kept", "f8", _JOINT),  # the team's plans while others are tried
        ("choices", "i8", (CHOICES,)),  # numbers of the most promising ones
        ("prices", "f8", (CHOICES,)),  # their costs
        ("grid", "f8", (COARSE**4,)),  # costs of a pair's constant plans
        (
            "places",
            "f8",
            (2, COARSE**2 + 1, 2),
        ),  # where those and the present ones lead in one step
        ("alone", "f8", (2, COARSE**2 + 1)),  # their costs without the other
        ("told", "f8", (2, COARSE**2 + 1, 3)),  # their information of one target
        ("stands", "f8"),  # cost of the present ones
        ("group", "i8", (MAX_JOINT // 2,)),  # robots whose plans are improved together
        ("members", "i8"),  # how many
        ("direction", "f8", _JOINT),
        ("gradient", "f8", _JOINT),  # by controls
        ("path", "f8", _PER_STEP),
        ("speeds", "f8", _PER_STEP),
        ("slope", "f8", _PER_STEP),  # gradient by positions
        ("speed_slope", "f8", _PER_STEP),
        ("speed_bend", "f8", _PER_STEP),  # first and second derivative by velocities
        ("bend", "f8", _MATRIX),  # Hessian, by positions first, then by controls
        ("factor", "f8", _MATRIX),
        ("vector", "f8", _JOINT),
        ("values", "f8", _JOINT),
        ("free", "i8", _JOINT),
        ("order", "i8", _JOINT),
        ("pairs", "i8", _JOINT),
        ("chain", "f8", (MAX_STEPS, CHAIN)),  # one target's covariances along the horizon
        ("twin", "f8", (MAX_STEPS, CHAIN)),  # the same as a team mate sees it
        ("springs", "i8"),  # hinges that the shifts would close
        ("timespec", "i8", (2,)),
    ],
    align=True,
)


class Team(NamedTuple):
    """The whole problem, pruned, and the plans as they stand."""

    setting: Table
    """(1,) SETTING."""

    robots: Table
    """(M,) ROBOT."""

    targets: Table
    """(N,) TARGET."""

    edges: Table
    """(E,) EDGE, row by row of the robots."""

    watch: IntArray
    """(E,) edges, row by row of the targets."""

    keep_zones: Table
    """(K,) ZONE, sensing."""

    keeps: IntArray
    """Sensing zones a robot knows and could enter."""

    jam_zones: Table
    """(K,) ZONE, communication."""

    jams: Table
    """JAM: communication zones a robot knows and could be jammed by."""

    mates: IntArray
    """Team mates that can be the farthest from a robot that can be jammed."""

    rows: IntArray
    """The same list transposed: robots whose spread a robot can set."""

    near: IntArray
    """Team mates that can come too near. Each pair stands in both rows."""

    discs: IntArray
    """Obstacles that can come too near."""

    obstacles: FloatArray
    """(K, 2)."""

    work: Table
    """(1,) WORK of the robot at work; (2,) where the team can be at work as a whole."""

    lengths: FloatArray
    """(M,) distances, or weights, of one robot's mates."""

    binding: Table
    """ROW: rows of the mates' that the robot at work can set."""
