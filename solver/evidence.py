"""What sightings from afar add to the information about their targets.

The extended Kalman filter's linearisation at the predicted mean, in information form. Where a
target is near (`near` tells which) it does not hold, and `solver.nearfield` takes over.
"""

import math

import numpy as np

from solver.arrays import BoolArray, FloatArray
from solver.problem import SensorModel
from solver.sensing import TARGET_FLOOR_M, variances, wrapped
from solver.sightings import Sightings

NEAR_DEVIATIONS = 5.0
"""A target is near when its predicted distance is below so many standard deviations of its
position; the floor on the distance counts as one more error."""


def near(sightings: Sightings, means: FloatArray, covariances: FloatArray) -> BoolArray:
    """Return which of n sightings are of targets so near that bearings are not linear, (n,).

    Only the prediction decides, so that the noise of the sighting itself plays no part.
    """
    rows = sightings.rows
    dx, dy = means[rows, 0] - sightings.x, means[rows, 1] - sightings.y
    spread = covariances[rows, 0, 0] + covariances[rows, 1, 1] + TARGET_FLOOR_M**2
    return np.asarray(dx * dx + dy * dy < NEAR_DEVIATIONS**2 * spread)


def gathered(
    sightings: Sightings,
    sensor: SensorModel,
    means: FloatArray,
    covariances: FloatArray,
    gate_probability: float | None,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return what n sightings say of N targets.

    Args:
        sightings: n of them.
        sensor: Their noise.
        means: Predicted states (N, d).
        covariances: Predicted position covariances (N, 2, 2).
        gate_probability: Quantile of the Mahalanobis distance beyond which one is an outlier.

    Returns:
        Information (N, 2, 2), information vectors (N, 2, 1) about the predicted positions, and
        which sightings were accepted (n,).
    """
    rows, count = sightings.rows, len(means)
    # d = target - robot; the rows of H are d'/rho and (Jd)'/rho^2.
    dx, dy = means[rows, 0] - sightings.x, means[rows, 1] - sightings.y
    squared = dx * dx + dy * dy
    floored = squared + TARGET_FLOOR_M**2
    rho = np.sqrt(floored)
    range_variance, bearing_variance = variances(sensor, squared)
    hx, hy, bx, by = dx / rho, dy / rho, -dy / floored, dx / floored
    nu_range = sightings.range - np.sqrt(squared)
    nu_bearing = wrapped(sightings.bearing - np.arctan2(dy, dx))
    w, v = 1.0 / range_variance, 1.0 / bearing_variance
    accepted = np.ones(len(rows), dtype=np.bool_)
    if gate_probability is not None:
        P = covariances[rows]
        a, b, c = P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]
        s11 = a * hx * hx + 2.0 * b * hx * hy + c * hy * hy + range_variance
        s22 = a * bx * bx + 2.0 * b * bx * by + c * by * by + bearing_variance
        s12 = a * hx * bx + b * (hx * by + hy * bx) + c * hy * by
        distance = nu_range**2 * s22 - 2.0 * nu_range * nu_bearing * s12 + nu_bearing**2 * s11
        accepted = distance <= gate(gate_probability) * (s11 * s22 - s12 * s12)
        w, v = w * accepted, v * accepted
    information = np.empty((count, 2, 2))
    information[:, 0, 0] = np.bincount(rows, w * hx * hx + v * bx * bx, count)
    information[:, 1, 1] = np.bincount(rows, w * hy * hy + v * by * by, count)
    information[:, 0, 1] = np.bincount(rows, w * hx * hy + v * bx * by, count)
    information[:, 1, 0] = information[:, 0, 1]
    r, s = w * nu_range, v * nu_bearing
    vector = np.empty((count, 2, 1))
    vector[:, 0, 0] = np.bincount(rows, r * hx + s * bx, count)
    vector[:, 1, 0] = np.bincount(rows, r * hy + s * by, count)
    return information, vector, accepted


def gate(probability: float) -> float:
    """Return that quantile of chi-square with two degrees of freedom: 1 - exp(-t/2) = p."""
    return -2.0 * math.log1p(-probability)
