"""What a robot measures of one target, written apart from the code that is tested: plain floats."""

import math

from solver.problem import SensorModel
from solver.sensing import LEAST_PRECISION, TARGET_FLOOR_M
from solver.zones import Point


def predicted(robot: Point, target: Point) -> tuple[float, float]:
    """Return the noise-free range (m) and bearing (rad, ENU, in (-pi, pi]) to a target."""
    east, north = target[0] - robot[0], target[1] - robot[1]
    return math.hypot(east, north), math.atan2(north, east)


def noise_variances(model: SensorModel, range_m: float) -> tuple[float, float]:
    """Return the variances of range (m^2) and bearing (rad^2) at a true distance."""
    rho = math.sqrt(range_m * range_m + TARGET_FLOOR_M**2)
    return (
        1.0 / max(model.range_peak * math.exp(-model.range_shape * rho), LEAST_PRECISION),
        1.0 / max(model.bearing_peak * math.exp(-model.bearing_shape * rho), LEAST_PRECISION),
    )
