"""Gaussian densities over the plane, and how points fall into groups. Frame ENU, metres."""

from collections.abc import Iterable

import numpy as np

from solver.arrays import FloatArray

Shape = tuple[FloatArray, FloatArray, float]
"""Centre (2,), covariance (2, 2) and mass of a mean density."""

NEAREST_M, FARTHEST_M = 2.5, 8.0
"""Evidence counts for a zone at least and at most so far from its centre."""

_ENOUGH_FOR_TWO = 3.5
"""Hits."""


def density(shapes: Iterable[Shape], points: FloatArray) -> FloatArray:
    """Return the sum (n,) of mean densities at points (n, 2)."""
    total = np.zeros(len(points))
    for centre, covariance, mass in shapes:
        total += mass * gaussian(points, centre, covariance)
    return total


def gaussian(points: FloatArray, centre: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the density of N(centre, covariance) at points (n, 2), (n,)."""
    a, b, d = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    area = a * d - b * b
    dx, dy = points[:, 0] - centre[0], points[:, 1] - centre[1]
    distance = (d * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / area
    return np.asarray(np.exp(-0.5 * distance) / (2.0 * np.pi * np.sqrt(area)))


def reach_m(covariance: FloatArray) -> float:
    """Return how far around a zone evidence tells anything of it, metres.

    `covariance` (2, 2) is that of its mean density, m^2.
    """
    deviation = float(np.sqrt(0.5 * np.trace(covariance)))
    return min(max(3.5 * deviation, NEAREST_M), FARTHEST_M)


def halves(points: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Return the centres (2,) of the two groups that points (n, 2) fall into along their long axis.

    None where there are too few of them, by their weights (n,), for two zones.
    """
    if len(points) < 2 or weights.sum() < _ENOUGH_FOR_TWO:
        return None
    mean = weights @ points / weights.sum()
    offset = points - mean
    _, axes = np.linalg.eigh((offset * weights[:, None]).T @ offset)
    ahead = offset @ axes[:, 1] > 0.0
    if ahead.all() or not ahead.any():
        return None
    groups = []
    for side in (ahead, ~ahead):
        groups.append(weights[side] @ points[side] / weights[side].sum())
    return groups[0], groups[1]
