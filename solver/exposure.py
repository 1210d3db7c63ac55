"""What it costs to be where attacks come from.

The chance constraint (paper, eq. 3) only asks a robot to stay outside a rim. The density of
attacks has no edge: at the rim it is still hit in 7 to 14 % of the steps on the paper authors'
scenarios, deep inside hardly more often than the hinge is expensive, and just outside nothing
draws it away. So the expected loss, `price * density(x)`, is part of the objective too: exposure
is bought everywhere at the same price. It is written as squared hinges at nested rims of each
zone, so that it is one more set of rows in the tables that every engine reads already.
"""

import math
from dataclasses import dataclass

import numpy as np

from solver.arrays import BoolArray, FloatArray, frozen, frozen_bool
from solver.beliefs import FilterSettings, MotionModel
from solver.problem import SensorModel, ZoneTable
from solver.zones import Zone

RIMS = ((2.2, 0.0274716), (2.7, 0.0886988), (3.3, 0.0571330))
"""(deviations q, share c): exp(-m^2/2) is nearly sum c max(0, q - m)^2 from 1 deviation outwards
(least squares up to 4). Further in the sum goes on rising where the density levels off: what
draws a robot out of a zone must not vanish in its middle."""

_NOMINAL_M = 1.0
"""Distance between robot and target at which a lost sighting is priced."""

_TO_REST = 400
"""Measurements after which a filter's variance has settled."""


@dataclass(frozen=True, slots=True)
class Prices:
    """What a density of 1/m^2 costs, in units of the kind's weight (m^4 per planning step)."""

    sensing: float = 0.0
    communication: float = 0.0


FREE = Prices()
"""Nothing but the chance constraints counts (the paper)."""


def zone_table(
    zones: list[Zone],
    known: BoolArray,
    quantiles: list[float],
    margins: list[float],
    severities: list[float],
    price: float,
) -> ZoneTable:
    """Return zones of one kind as the optimizer's arrays, rows of the exposure behind.

    Args:
        zones: K zones.
        known: (M, K) whether a zone constrains a robot.
        quantiles: Factor on the deviation of each zone's own rim.
        margins: Metres (sensing) or factor on the spread (communication) of that rim.
        severities: Multiplier of each zone's hinge and density.
        price: Of a density of 1/m^2 (`Prices`); at 0 there are no further rows.

    Returns:
        A table of K rows, or of K (1 + len(RIMS)).
    """
    rims = RIMS if price > 0.0 and math.isfinite(price) else ()
    centres = np.reshape([zone.mean for zone in zones], (-1, 2))
    covariances = np.reshape([zone.covariance for zone in zones], (-1, 2, 2))
    severity = np.asarray(severities, dtype=np.float64)
    area = np.sqrt(np.maximum(np.linalg.det(covariances), 0.0))
    # A hinge is in metres: c (q - m)^2 times the peak 1/(2 pi area), m = distance / deviation.
    scale = np.divide(price * severity, 2.0 * np.pi * area**2, out=0.0 * area, where=area > 0.0)
    copies = 1 + len(rims)
    return ZoneTable(
        centres=frozen(np.tile(centres, (copies, 1))),
        covariances=frozen(np.tile(covariances, (copies, 1, 1))),
        margins=frozen(_stacked(margins, [0.0 * area] * len(rims))),
        quantiles=frozen(_stacked(quantiles, [np.full(len(zones), q) for q, _ in rims])),
        severities=frozen(_stacked(severities, [share * scale for _, share in rims])),
        known=frozen_bool(np.tile(known, (1, copies))),
    )


def sight_loss(
    watchers: int, settings: FilterSettings, sensor: SensorModel, tick_s: float, failure_s: float
) -> float:
    """Return what a failure of one of a target's watchers costs: the integral of tr P, m^2 s.

    The difference, over the failure, between the trace without that watcher and the settled
    trace with all of them, each measuring once per tick from a nominal distance, range and
    bearing averaged over the axes.

    Args:
        watchers: Robots assigned to the target, at least 1.
        settings: The filter.
        sensor: The noise.
        tick_s: Time between measurements.
        failure_s: How long a failure is taken to last.
    """
    told = _nominal_information(sensor)
    F, Q = _axis_model(settings, tick_s)
    P = settings.prior_variance * np.eye(len(F))
    for _ in range(_TO_REST):
        P = _measured(F @ P @ F.T + Q, watchers * told)
    settled, loss, left_s = P[0, 0], 0.0, failure_s
    while left_s > 1e-9:
        P = _measured(F @ P @ F.T + Q, (watchers - 1) * told)
        loss += min(tick_s, left_s) * 2.0 * float(P[0, 0] - settled)
        left_s -= tick_s
    return loss


def _nominal_information(sensor: SensorModel) -> float:
    """Return the information per axis (1/m^2) of one sighting from the nominal distance."""
    along = sensor.range_peak * math.exp(-sensor.range_shape * _NOMINAL_M)
    across = sensor.bearing_peak * math.exp(-sensor.bearing_shape * _NOMINAL_M)
    return 0.5 * (along + across / _NOMINAL_M**2)


def _axis_model(settings: FilterSettings, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Return transition and process noise of one axis."""
    q = settings.process_noise
    if settings.model is MotionModel.RANDOM_WALK:
        return np.eye(1), np.array([[q * dt_s]])
    F = np.array([[1.0, dt_s], [0.0, 1.0]])
    return F, q * np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]])


def _measured(P: FloatArray, information: float) -> FloatArray:
    """Return the covariance after a measurement of the first state."""
    gain = P[:, :1] * (information / (1.0 + information * P[0, 0]))
    return np.asarray(P - gain @ P[:1])


def _stacked(own: list[float], rims: list[FloatArray]) -> FloatArray:
    return np.concatenate([np.asarray(own, dtype=np.float64), *rims])
