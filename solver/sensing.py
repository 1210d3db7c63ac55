"""What a robot measures of a target, and how much that tells.

A robot at x measures range and bearing to a target at y. With `p = x - y` and
`rho = sqrt(p'p + f^2)` the rows of the measurement matrix are `H_range = -p'/rho` and
`H_bearing = (J p)'/rho^2`, `J = [[0, -1], [1, 0]]`, and the inverse noise falls with distance,
`1/R = peak exp(-shape rho)` (paper, section III-A). The floor f keeps a robot exactly above
its target from seeming to know everything; it is part of the model.
"""

import math

import numpy as np

from solver.arrays import FloatArray
from solver.problem import SensorModel

TARGET_FLOOR_M = 0.1
"""Floor f on the distance between a robot and a target."""

LEAST_PRECISION = 1e-30
"""Of a measurement from so far away that its exponential noise would overflow."""


def variances(model: SensorModel, squared_distance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the variances of range (m^2) and bearing (rad^2) for p'p (m^2) of any shape."""
    rho = np.sqrt(squared_distance + TARGET_FLOOR_M**2)
    along = model.range_peak * np.exp(-model.range_shape * rho)
    across = model.bearing_peak * np.exp(-model.bearing_shape * rho)
    return 1.0 / np.maximum(along, LEAST_PRECISION), 1.0 / np.maximum(across, LEAST_PRECISION)


def wrapped(angle: FloatArray) -> FloatArray:
    """Return angles (rad) brought into [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def gains(model: SensorModel, squared_distance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the factors a, b of the information `a p p' + b (Jp)(Jp)'`.

    Args:
        model: The sensor.
        squared_distance: p'p, any shape, m^2.

    Returns:
        a in 1/m^4 and b in 1/m^4, each of the shape given.
    """
    squared = squared_distance + TARGET_FLOOR_M**2
    rho = np.sqrt(squared)
    along = model.range_peak * np.exp(-model.range_shape * rho) / squared
    across = model.bearing_peak * np.exp(-model.bearing_shape * rho) / (squared * squared)
    return along, across


def information(model: SensorModel, offsets: FloatArray) -> FloatArray:
    """Return `H' R^-1 H` of one range-bearing measurement.

    Args:
        model: The sensor.
        offsets: Robot minus target, shape (..., 2), m.

    Returns:
        Shape (..., 2, 2), symmetric positive semidefinite, 1/m^2.
    """
    x, y = offsets[..., 0], offsets[..., 1]
    along, across = gains(model, x * x + y * y)
    result = np.empty((*offsets.shape[:-1], 2, 2))
    result[..., 0, 0] = along * x * x + across * y * y
    result[..., 1, 1] = along * y * y + across * x * x
    result[..., 0, 1] = result[..., 1, 0] = (along - across) * x * y
    return result
