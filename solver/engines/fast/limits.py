"""Effort, and the squared hinges of the field and of the speed beyond the first step.

The first step's limits are hard and stand in the box of the controls instead.
"""

from solver.arrays import FloatArray
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Motion


@inlined
def _excess(value: float, lower: float, upper: float) -> float:
    """Return how far a value is outside its interval, with the sign of the side."""
    if value < lower:
        return value - lower
    return value - upper if value > upper else 0.0


@kernel
def limits_cost(
    motion: Motion, i: int, u: FloatArray, path: FloatArray, speeds: FloatArray
) -> float:
    """Return effort and hinges of robot i for controls (2H,) and what they lead to."""
    total = 0.0
    for at in range(u.shape[0]):
        total += motion.effort * u[at] * u[at]
    for k in range(1, path.shape[0]):
        for axis in range(2):
            excess = _excess(path[k, axis], motion.field[axis], motion.field[2 + axis])
            if motion.double:
                over = _excess(speeds[k, axis], -motion.speed[i], motion.speed[i])
                total += motion.field_weight * over * over
            total += motion.field_weight * excess * excess
    return total


@kernel
def add_limits(
    motion: Motion,
    i: int,
    path: FloatArray,
    speeds: FloatArray,
    slope: FloatArray,
    bend: FloatArray,
    speed_slope: FloatArray,
    speed_bend: FloatArray,
) -> None:
    """Add the derivatives of the hinges by the path; those by velocities are set."""
    twice = 2.0 * motion.field_weight
    for k in range(path.shape[0]):
        for axis in range(2):
            speed_slope[k, axis] = 0.0
            speed_bend[k, axis] = 0.0
            if k == 0:
                continue
            excess = _excess(path[k, axis], motion.field[axis], motion.field[2 + axis])
            if excess != 0.0:
                slope[k, axis] += twice * excess
                bend[2 * k + axis, 2 * k + axis] += twice
            if motion.double:
                over = _excess(speeds[k, axis], -motion.speed[i], motion.speed[i])
                if over != 0.0:
                    speed_slope[k, axis] = twice * over
                    speed_bend[k, axis] = twice
