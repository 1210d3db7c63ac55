"""The hard box of the controls, and how far a robot gets within it."""

from math import hypot

from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Table
from solver.engines.fast.request import Movement


@inlined
def _narrowed(lower: float, upper: float, least: float, most: float) -> tuple[float, float]:
    """Return the interval intersected with another; if they miss, its end nearest to it."""
    return min(max(least, lower), upper), max(min(most, upper), lower)


@kernel
def fill_box(setting: Table, robots: Table, movement: Movement) -> None:
    """Fill the robots' boxes: that of the first step keeps speed limit and field as well.

    Where they leave nothing, the robot moves towards the field as fast as its controls (and,
    before that, its speed limit) allow.
    """
    step, size = setting.step, 2 * setting.steps
    for i in range(robots.shape[0]):
        robot = robots[i]
        for axis in range(2):
            low, high = movement.control_lower[i, axis], movement.control_upper[i, axis]
            for at in range(2 + axis, size, 2):
                robot.lower[at], robot.upper[at] = low, high
            x, v = robot.position[axis], robot.velocity[axis]
            scale = step
            if setting.double:
                low, high = _narrowed(
                    low, high, (-robot.speed - v) / step, (robot.speed - v) / step
                )
                x += step * v
                scale = 0.5 * step * step
            low, high = _narrowed(
                low, high, (setting.field[axis] - x) / scale, (setting.field[2 + axis] - x) / scale
            )
            robot.lower[axis], robot.upper[axis] = low, high


@kernel
def fill_reach(setting: Table, robots: Table) -> None:
    """Fill an upper bound of the distance each robot covers within the horizon."""
    time = setting.steps * setting.step
    for i in range(robots.shape[0]):
        robot = robots[i]
        most_x = most_y = 0.0
        for at in range(0, 2 * setting.steps, 2):
            most_x = max(most_x, max(abs(robot.lower[at]), abs(robot.upper[at])))
            most_y = max(most_y, max(abs(robot.lower[at + 1]), abs(robot.upper[at + 1])))
        if setting.double:
            most_x = abs(robot.velocity[0]) * time + 0.5 * time * time * most_x
            most_y = abs(robot.velocity[1]) * time + 0.5 * time * time * most_y
        else:
            most_x *= time
            most_y *= time
        robot.reach = hypot(most_x, most_y)
