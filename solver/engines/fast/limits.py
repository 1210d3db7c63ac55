"""Effort, and the squared hinges of the field and of the speed beyond the first step.

The first step's limits are hard and stand in the box of the controls instead.
"""

from solver.arrays import FloatArray
from solver.engines.fast.jit import inlined
from solver.engines.fast.layout import Team


@inlined
def _excess(value: float, lower: float, upper: float) -> float:
    """Return how far a value is outside its interval, with the sign of the side."""
    if value < lower:
        return value - lower
    return value - upper if value > upper else 0.0


@inlined
def limits_cost(team: Team, i: int, u: FloatArray) -> float:
    """Return effort and hinges of robot i for controls (2H,) and the path they lead to."""
    setting, robot, work = team.setting[0], team.robots[i], team.work[0]
    total = 0.0
    for k in range(setting.steps):
        for axis in range(2):
            control = u[2 * k + axis]
            total += setting.effort * control * control
            if k == 0:
                continue
            excess = _excess(work.path[k, axis], setting.field[axis], setting.field[2 + axis])
            total += setting.field_weight * excess * excess
            if setting.double:
                over = _excess(work.speeds[k, axis], -robot.speed, robot.speed)
                total += setting.field_weight * over * over
    return total


@inlined
def add_limits(team: Team, i: int) -> None:
    """Add the derivatives of the hinges by the path; those by velocities are set."""
    setting, robot, work = team.setting[0], team.robots[i], team.work[0]
    twice = 2.0 * setting.field_weight
    for k in range(setting.steps):
        for axis in range(2):
            work.speed_slope[k, axis] = work.speed_bend[k, axis] = 0.0
            if k == 0:
                continue
            excess = _excess(work.path[k, axis], setting.field[axis], setting.field[2 + axis])
            if excess != 0.0:
                work.slope[k, axis] += twice * excess
                work.bend[2 * k + axis, 2 * k + axis] += twice
            if setting.double:
                over = _excess(work.speeds[k, axis], -robot.speed, robot.speed)
                if over != 0.0:
                    work.speed_slope[k, axis] = twice * over
                    work.speed_bend[k, axis] = twice
