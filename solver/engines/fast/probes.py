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
from solver.engines.fast.robot import cost

HYSTERESIS = 1e-4
"""Relative gain below which the plan stays as it is."""

_DIRECTIONS = 9


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
def fresh_start(team: Team, i: int, rows: int, u: FloatArray) -> None:
    """Fill u (2H,) with the best of the constant plans."""
    chosen, least = 0, 0.0
    for direction in range(_DIRECTIONS):
        _constant_plan(team, i, direction, u)
        reached = cost(team, i, rows, u)
        if direction == 0 or reached < least:
            chosen, least = direction, reached
    _constant_plan(team, i, chosen, u)
