"""The hard box of the controls, and how far a robot gets within it."""

from math import hypot

from solver.arrays import FloatArray
from solver.engines.fast.jit import inlined, kernel


@inlined
def _narrowed(lower: float, upper: float, least: float, most: float) -> tuple[float, float]:
    """Return the interval intersected with another; if they miss, its end nearest to it."""
    return min(max(least, lower), upper), max(min(most, upper), lower)


@kernel
def fill_box(
    step: float,
    double: bool,
    positions: FloatArray,
    velocities: FloatArray,
    control_lower: FloatArray,
    control_upper: FloatArray,
    speed: FloatArray,
    field: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
) -> None:
    """Fill lower and upper (M, 2H): the first step keeps speed limit and field as well.

    Where they leave nothing, the robot moves towards the field as fast as its controls (and,
    before that, its speed limit) allow.
    """
    for i in range(positions.shape[0]):
        for axis in range(2):
            low, high = control_lower[i, axis], control_upper[i, axis]
            for at in range(2 + axis, lower.shape[1], 2):
                lower[i, at], upper[i, at] = low, high
            x, v = positions[i, axis], velocities[i, axis]
            scale = step
            if double:
                low, high = _narrowed(
                    low, high, (-speed[i] - v) / step, (speed[i] - v) / step
                )
                x += step * v
                scale = 0.5 * step * step
            low, high = _narrowed(
                low, high, (field[axis] - x) / scale, (field[2 + axis] - x) / scale
            )
            lower[i, axis], upper[i, axis] = low, high


@kernel
def fill_reach(
    step: float,
    double: bool,
    velocities: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    reach: FloatArray,
) -> None:
    """Fill reach (M,): an upper bound of the distance covered within the horizon."""
    for i in range(reach.shape[0]):
        size = lower.shape[1]
        time = 0.5 * size * step
        most_x = most_y = 0.0
        for at in range(0, size, 2):
            most_x = max(most_x, abs(lower[i, at]), abs(upper[i, at]))
            most_y = max(most_y, abs(lower[i, at + 1]), abs(upper[i, at + 1]))
        if double:
            most_x = abs(velocities[i, 0]) * time + 0.5 * time * time * most_x
            most_y = abs(velocities[i, 1]) * time + 0.5 * time * time * most_y
        else:
            most_x *= time
            most_y *= time
        reach[i] = hypot(most_x, most_y)
