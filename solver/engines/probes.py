"""Other starts for robots that a local method would leave where they are.

At one step ahead every local method, IPOPT included, sits for ever in a zone's centre when its
target is there too: the hinge is flat at the centre, and the target holds the robot. One
start with such robots sent away, adopted only when clearly better, frees them; the margin
keeps two equally good plans from taking turns.
"""

import math
from collections.abc import Callable

import numpy as np

from solver.arrays import BoolArray, FloatArray, IntArray
from solver.problem import Problem, ZoneTable

HYSTERESIS = 3e-4
"""A probe is adopted when it lowers the objective by more than this share of it."""

_DIRECTIONS = np.array(
    [(math.cos(angle), math.sin(angle)) for angle in np.arange(8) * (math.pi / 4.0)]
)


def stuck(problem: Problem) -> IntArray:
    """Return the rows of the robots to probe: asked for by name, or inside a known zone.

    Inside means nearer to the centre than the zone's own keep-out radius without the margin.
    """
    inside = problem.replan.copy()
    for table in (problem.sensing, problem.communication):
        if table.known.any():
            inside |= _inside(table, problem.positions)
    return np.flatnonzero(inside)


def _inside(table: ZoneTable, positions: FloatArray) -> BoolArray:
    offset = table.centres[None] - positions[:, None]
    squared = (offset * offset).sum(axis=-1)
    directed = np.einsum("mki,kij,mkj->mk", offset, table.covariances, offset)
    # |a| < q sqrt(n'Sn)  <=>  |a|^4 < q^2 a'Sa, which also holds its own at the centre.
    near = squared * squared <= table.quantiles**2 * directed
    return np.asarray((near & table.known).any(axis=1))


def probe_start(
    controls: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    rows: IntArray,
    costs: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return controls in which each row's robot makes for the best of eight directions.

    Args:
        controls: (M, H, 2) the plan to depart from.
        lower: (M, H, 2) bounds.
        upper: (M, H, 2) bounds.
        rows: Robots to send away.
        costs: Objective of a stack of plans (S, M, H, 2), shape (S,).
    """
    start = controls.copy()
    reach = np.maximum(np.abs(lower), np.abs(upper))
    for row in rows:
        # One robot after the other, so that two at one spot do not go the same way.
        trials = np.repeat(start[None], len(_DIRECTIONS), axis=0)
        trials[:, row] = _DIRECTIONS[:, None] * reach[row]
        trials = np.clip(trials, lower, upper)
        values = costs(trials)
        if np.isfinite(values).any():
            start[row] = trials[int(np.nanargmin(values)), row]
    return start
