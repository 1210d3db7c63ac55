"""Probe starts: second opinions about a robot's plan.

A descent from the last plan alone can sit for ever where the gradient vanishes (in the
middle of a zone when the target is there too, on top of a team mate) or behind a ridge that
the last plan happened to start on. A probe looks at a handful of constant plans, descends
from the best of them, and replaces the plan only where it is better by a margin, or robots
would tremble between equals.
"""

from solver.arrays import FloatArray
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Team
from solver.engines.fast.newton import descend
from solver.engines.fast.robot import cost

HYSTERESIS = 1e-4
"""Relative gain below which the plan stays as it is."""

_DIRECTIONS = 9
_STEPS = 8
"""Newton steps per probe."""


@kernel
def _constant_plan(team: Team, i: int, direction: int, u: FloatArray) -> None:
    """Fill u (2H,) with one of nine constant plans: rest, or a corner or side of the box."""
    robot = team.robots[i]
    for at in range(2 * team.setting[0].steps):
        sign = (direction // 3 if at % 2 == 0 else direction % 3) - 1
        lower, upper = robot.lower[at], robot.upper[at]
        if sign == 0:
            u[at] = min(max(0.0, lower), upper)
        else:
            u[at] = upper if sign > 0 else lower


@kernel
def probe(team: Team, i: int, rows: int, value: float, deadline: float) -> tuple[float, int]:
    """Try a fresh start for robot i, whose plan costs `value` and stands in work.u.

    Where the fresh start ends lower (by the hysteresis, unless it is to be replanned), it
    takes the plan's place. Returns the cost of the plan then in work.u, and the Newton steps.
    """
    work, robot = team.work[0], team.robots[i]
    chosen, least = 0, 0.0
    for direction in range(_DIRECTIONS):
        _constant_plan(team, i, direction, work.fresh)
        reached = cost(team, i, rows, work.fresh)
        if direction == 0 or reached < least:
            chosen, least = direction, reached
    _constant_plan(team, i, chosen, work.fresh)
    _, reached, steps, _ = descend(team, i, rows, work.fresh, _STEPS, deadline)
    margin = 0.0 if robot.replan else HYSTERESIS
    if reached < value - margin * abs(value):
        for at in range(2 * team.setting[0].steps):
            work.u[at] = work.fresh[at]
        return reached, steps
    return value, steps
