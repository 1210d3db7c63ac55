"""What is done to a problem before anybody solves it: whatever arrives, what leaves is sound."""

import math
from dataclasses import replace

import numpy as np

from solver import matrices
from solver.arrays import BoolArray, FloatArray, frozen
from solver.directives import Weights
from solver.objective import PRIOR_GREATEST, PRIOR_LEAST
from solver.problem import Dynamics, Problem, ZoneTable

FAR_M = 1e6
"""No position, velocity or bound is taken to be beyond this: squares must stay exact."""


def is_solvable(problem: Problem) -> bool:
    """Return whether there is a team, a horizon and a step to plan with at all."""
    return bool(problem.robot_ids) and problem.horizon >= 1 and 0.0 < problem.step_s < math.inf


def plannable(problem: Problem) -> BoolArray:
    """Return (M,) which robots' states are numbers: the other ones cannot be planned for."""
    usable = np.isfinite(problem.positions).all(axis=1)
    if problem.dynamics is Dynamics.DOUBLE_INTEGRATOR:
        usable &= np.isfinite(problem.velocities).all(axis=1)
    return np.asarray(usable)


def subset(problem: Problem, keep: BoolArray) -> Problem:
    """Return the problem of some of the robots; the other ones are left out of everything.

    Args:
        problem: Of M robots. A last plan of another number of robots is left out too.
        keep: (M,) which of them.
    """

    def known(table: ZoneTable) -> ZoneTable:
        return replace(table, known=table.known[keep])

    previous = problem.previous
    if previous is not None:
        previous = previous[keep] if len(previous) == len(keep) else None
    return replace(
        problem,
        robot_ids=tuple(np.array(problem.robot_ids)[keep].tolist()),
        positions=problem.positions[keep],
        velocities=problem.velocities[keep],
        control_lower=problem.control_lower[keep],
        control_upper=problem.control_upper[keep],
        speed_limit=problem.speed_limit[keep],
        sees=problem.sees[keep],
        sensing=known(problem.sensing),
        communication=known(problem.communication),
        previous=previous,
        replan=problem.replan[keep],
    )


def repaired(problem: Problem) -> Problem:
    """Return a sound problem; the same object when it was so already.

    Sound: numbers are finite, bounds are ordered, covariances are positive definite.
    Robots' positions must be finite (`plannable`). A bound that is no ordinary number becomes 0
    (no motion), bounds the wrong way round are exchanged; a target, zone or obstacle whose place
    is not a number is left out; negative weights become 0.
    """
    if _is_sound(problem):
        return problem
    problem = _robots_repaired(problem)
    problem = _targets_repaired(problem)
    here = np.isfinite(problem.obstacles).all(axis=1)
    weights = Weights(*(_clean(w) for w in problem.weights))
    previous = problem.previous
    if previous is not None and not _fits(problem, previous):
        previous = None
    return replace(
        problem,
        sensing=_zones_repaired(problem.sensing),
        communication=_zones_repaired(problem.communication),
        obstacles=_bounded(problem.obstacles[here]),
        weights=weights,
        separation_weight=_clean(problem.separation_weight),
        field_weight=_clean(problem.field_weight),
        min_dist_m=_clean(problem.min_dist_m),
        previous=previous,
    )


def control_limits(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Return the control box (M, 2), (M, 2), ordered and of ordinary numbers."""
    low, high = (
        np.where(np.abs(bound) <= FAR_M, bound, 0.0)
        for bound in (problem.control_lower, problem.control_upper)
    )
    return frozen(np.minimum(low, high)), frozen(np.maximum(low, high))


def _is_sound(problem: Problem) -> bool:
    """Return whether nothing has to be repaired. On the way of every tick: kept cheap."""
    scalars = (
        *problem.weights,
        problem.separation_weight,
        problem.field_weight,
        problem.min_dist_m,
    )
    if min(scalars) < 0.0 or not math.isfinite(sum(scalars)):
        return False
    if problem.previous is not None and not _fits(problem, problem.previous):
        return False
    s, c = problem.sensing, problem.communication
    places = np.concatenate(
        [
            array.ravel()
            for array in (
                problem.positions,
                problem.velocities,
                problem.control_lower,
                problem.control_upper,
                problem.speed_limit,
                problem.field_lower,
                problem.field_upper,
                problem.target_means,
                problem.target_priors,
                problem.target_growth,
                problem.obstacles,
                *(s.centres, s.covariances, s.margins, s.quantiles, s.severities),
                *(c.centres, c.covariances, c.margins, c.quantiles, c.severities),
            )
        ]
    )
    # A comparison with NaN is false, so this finds everything that is no ordinary number.
    if not (np.abs(places) <= FAR_M).all():
        return False
    ordered = (problem.control_lower <= problem.control_upper).all()
    if not (ordered and (problem.field_lower <= problem.field_upper).all()):
        return False
    spreads = np.concatenate((problem.target_priors, s.covariances, c.covariances))
    if matrices.clamped(spreads, PRIOR_LEAST, PRIOR_GREATEST) is not spreads:
        return False
    growth = problem.target_growth[1:]
    return matrices.clamped(growth, 0.0, PRIOR_GREATEST) is growth if growth.size else True


def _fits(problem: Problem, previous: FloatArray) -> bool:
    shape = (len(problem.robot_ids), problem.horizon, 2)
    return previous.shape == shape and bool(np.isfinite(previous).all())


def _clean(value: float) -> float:
    return float(np.clip(np.nan_to_num(value, nan=0.0), 0.0, FAR_M))


def _bounded(values: FloatArray) -> FloatArray:
    return frozen(np.clip(np.nan_to_num(values, nan=0.0), -FAR_M, FAR_M))


def _covariances(stack: FloatArray, least: float) -> FloatArray:
    clean = np.nan_to_num(stack, nan=PRIOR_GREATEST, posinf=PRIOR_GREATEST, neginf=0.0)
    clean = matrices.symmetric(np.clip(clean, -FAR_M, FAR_M))
    return frozen(matrices.clamped(clean, least, PRIOR_GREATEST))


def _robots_repaired(problem: Problem) -> Problem:
    control_lower, control_upper = control_limits(problem)
    # A field edge that is not a number is no edge.
    low = np.nan_to_num(problem.field_lower, nan=-FAR_M)
    high = np.nan_to_num(problem.field_upper, nan=FAR_M)
    low, high = _bounded(low), _bounded(high)
    return replace(
        problem,
        positions=_bounded(problem.positions),
        velocities=_bounded(problem.velocities),
        control_lower=control_lower,
        control_upper=control_upper,
        speed_limit=frozen(np.abs(_bounded(problem.speed_limit))),
        field_lower=frozen(np.minimum(low, high)),
        field_upper=frozen(np.maximum(low, high)),
    )


def _targets_repaired(problem: Problem) -> Problem:
    here = np.isfinite(problem.target_means).all(axis=(0, 2))
    return replace(
        problem,
        sees=problem.sees & here,
        target_means=_bounded(problem.target_means),
        target_priors=_covariances(problem.target_priors, PRIOR_LEAST),
        target_growth=_covariances(problem.target_growth, 0.0),
    )


def _zones_repaired(table: ZoneTable) -> ZoneTable:
    numbers = (table.margins, table.quantiles, table.severities)
    here = np.isfinite(table.centres).all(axis=1) & np.isfinite(np.stack(numbers)).all(axis=0)
    return ZoneTable(
        centres=_bounded(table.centres),
        covariances=_covariances(table.covariances, PRIOR_LEAST),
        margins=_bounded(table.margins),
        quantiles=frozen(np.maximum(_bounded(table.quantiles), 0.0)),
        severities=frozen(np.maximum(_bounded(table.severities), 0.0)),
        known=table.known & here,
    )
