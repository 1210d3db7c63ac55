"""From a problem to the request of the compiled routine: plain read-only arrays."""

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
_NOTHING.setflags(write=False)

Request = tuple[Movement, Targets, Hazards, Hazards, Safety, Start]


def packed(problem: Problem, start: FloatArray | None, budget: Budget) -> Request:
    """Return the request for a problem, started from controls (M, H, 2) or from nothing.

    The budget's time starts to run here.
    """
    deadline = np.inf if budget.deadline_s is None else monotonic() + budget.deadline_s
    return (
        _movement(problem),
        _targets(problem),
        _hazards(problem.sensing, problem.weights.sensing),
        _hazards(problem.communication, problem.weights.communication),
        _safety(problem),
        Start(
            previous=_NOTHING if start is None else _fixed(start),
            replan=_fixed(problem.replan, np.bool_),
            iterations=budget.iterations,
            deadline=float(deadline),
        ),
    )


def _fixed(values: _Array, dtype: type = np.float64) -> _Array:
    """Return a contiguous read-only view, which is what the signature asks for."""
    flags = values.flags
    if values.dtype == dtype and flags.c_contiguous and not flags.writeable:
        return values
    view: NDArray[Any] = np.ascontiguousarray(values, dtype=dtype).view()
    view.setflags(write=False)
    return cast(_Array, view)


def _movement(problem: Problem) -> Movement:
    return Movement(
        step=problem.step_s,
        double=problem.dynamics is Dynamics.DOUBLE_INTEGRATOR,
        positions=_fixed(problem.positions),
        velocities=_fixed(problem.velocities),
        control_lower=_fixed(problem.control_lower),
        control_upper=_fixed(problem.control_upper),
        speed=_fixed(problem.speed_limit),
        field_lower=_fixed(problem.field_lower),
        field_upper=_fixed(problem.field_upper),
        field_weight=problem.field_weight,
        effort=problem.weights.control,
        order=_fixed(problem.positions[:, 0].argsort(kind="stable"), np.int64),
    )


def _targets(problem: Problem) -> Targets:
    sensor = problem.sensor
    return Targets(
        seen=_fixed(np.flatnonzero(problem.sees), np.int64),
        means=_fixed(problem.target_means),
        priors=_fixed(problem.target_priors),
        growth=_fixed(problem.target_growth),
        range_peak=sensor.range_peak,
        range_shape=sensor.range_shape,
        bearing_peak=sensor.bearing_peak,
        bearing_shape=sensor.bearing_shape,
        floor=TARGET_FLOOR_M,
        weight=problem.weights.tracking,
        prior_least=PRIOR_LEAST,
        prior_greatest=PRIOR_GREATEST,
    )


def _hazards(table: ZoneTable, weight: float) -> Hazards:
    return Hazards(
        centres=_fixed(table.centres),
        covariances=_fixed(table.covariances),
        margins=_fixed(table.margins),
        quantiles=_fixed(table.quantiles),
        severities=_fixed(table.severities),
        known=_fixed(table.known, np.bool_),
        weight=weight,
    )


def _safety(problem: Problem) -> Safety:
    return Safety(
        obstacles=_fixed(problem.obstacles),
        distance=problem.min_dist_m,
        weight=problem.separation_weight,
        zone_smoothing=ZONE_SMOOTHING_M,
        mate_smoothing=MATE_SMOOTHING_M,
    )
