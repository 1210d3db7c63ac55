"""From a problem to the request of the compiled routine: plain contiguous arrays.

For two robots this takes a tenth of the whole solve, hence records filled by position.
"""

from math import inf
from time import monotonic
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from solver.arrays import FloatArray
from solver.engines.fast.request import Hazards, Movement, Safety, Start, Targets
from solver.objective import (
    MATE_SMOOTHING_M,
    PRIOR_GREATEST,
    PRIOR_LEAST,
    TARGET_FLOOR_M,
    ZONE_SMOOTHING_M,
)
from solver.problem import Budget, Dynamics, Problem, ZoneTable

_Array = TypeVar("_Array", bound=NDArray[Any])

_NOTHING = np.zeros((0, 0, 0))
_FLOAT, _TRUTH, _WHOLE = np.dtype(np.float64), np.dtype(np.bool_), np.dtype(np.int64)

Request = tuple[Movement, Targets, Hazards, Hazards, Safety, Start]


def packed(problem: Problem, start: FloatArray | None, budget: Budget) -> Request:
    """Return the request for a problem, started from controls (M, H, 2) or from nothing.

    The budget's time starts to run here.
    """
    deadline = inf if budget.deadline_s is None else monotonic() + budget.deadline_s
    return (
        _movement(problem),
        _targets(problem),
        _hazards(problem.sensing, problem.weights.sensing),
        _hazards(problem.communication, problem.weights.communication),
        _safety(problem),
        Start(
            _NOTHING if start is None else _fixed(start),
            _fixed(problem.replan, _TRUTH),
            budget.iterations,
            deadline,
        ),
    )


def _fixed(values: _Array, kind: np.dtype[Any] = _FLOAT) -> _Array:
    """Return a contiguous array of the kind that the signature asks for; most are."""
    if values.dtype is kind and values.flags.c_contiguous:
        return values
    return cast(_Array, np.ascontiguousarray(values, dtype=kind))


def _movement(problem: Problem) -> Movement:
    return Movement(
        problem.step_s,
        problem.dynamics is Dynamics.DOUBLE_INTEGRATOR,
        _fixed(problem.positions),
        _fixed(problem.velocities),
        _fixed(problem.control_lower),
        _fixed(problem.control_upper),
        _fixed(problem.speed_limit),
        _fixed(problem.field_lower),
        _fixed(problem.field_upper),
        problem.field_weight,
        problem.weights.control,
        _fixed(problem.positions[:, 0].argsort(kind="stable"), _WHOLE),
    )


def _targets(problem: Problem) -> Targets:
    sensor = problem.sensor
    return Targets(
        _fixed(problem.sees.ravel().nonzero()[0], _WHOLE),
        _fixed(problem.target_means),
        _fixed(problem.target_priors),
        _fixed(problem.target_growth),
        sensor.range_peak,
        sensor.range_shape,
        sensor.bearing_peak,
        sensor.bearing_shape,
        TARGET_FLOOR_M,
        problem.weights.tracking,
        PRIOR_LEAST,
        PRIOR_GREATEST,
    )


def _hazards(table: ZoneTable, weight: float) -> Hazards:
    return Hazards(
        _fixed(table.centres),
        _fixed(table.covariances),
        _fixed(table.margins),
        _fixed(table.quantiles),
        _fixed(table.severities),
        _fixed(table.known, _TRUTH),
        weight,
    )


def _safety(problem: Problem) -> Safety:
    return Safety(
        _fixed(problem.obstacles),
        problem.min_dist_m,
        problem.separation_weight,
        ZONE_SMOOTHING_M,
        MATE_SMOOTHING_M,
    )
