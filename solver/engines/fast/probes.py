"""Probe starts: second opinions about a robot's plan.

A descent from the last plan alone can sit for ever where the gradient vanishes (in the
middle of a zone when the target is there too, on top of a team mate) or behind a ridge that
the last plan happened to start on. A probe looks at a handful of constant plans, descends
from the best of them, and replaces the plan only where it is better by a margin, or robots
would tremble between equals.
"""

from solver.arrays import FloatArray
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Motion, Team
from solver.engines.fast.newton import descend
from solver.engines.fast.robot import cost

HYSTERESIS = 1e-4
"""Relative gain below which the plan stays as it is."""

_DIRECTIONS = 9


@kernel
def _constant_plan(motion: Motion, i: int, direction: int, u: FloatArray) -> None:
    """Fill u (2H,) with one of nine constant plans: rest, or a corner or side of the box."""
    for at in range(u.shape[0]):
        sign = (direction // 3 if at % 2 == 0 else direction % 3) - 1
        lower, upper = motion.lower[i, at], motion.upper[i, at]
        if sign == 0:
            u[at] = min(max(0.0, lower), upper)
        else:
            u[at] = upper if sign > 0 else lower


@kernel
def probe(
    team: Team, i: int, rows: int, value: float, margin: float, most: int, deadline: float
) -> tuple[float, int]:
    """Try a fresh start for robot i, whose plan costs `value` and stands in scratch.u.

    Where the fresh start ends lower by `margin` (relative), it takes the plan's place.
    Returns the cost of the plan then in scratch.u, and the Newton steps taken.
    """
    u, fresh, best = team.scratch.u, team.scratch.fresh, value
    chosen = -1
    for direction in range(_DIRECTIONS):
        _constant_plan(team.motion, i, direction, fresh)
        reached = cost(team, i, rows, fresh)
        if chosen < 0 or reached < best:
            best, chosen = reached, direction
    _constant_plan(team.motion, i, chosen, fresh)
    _, reached, steps, _ = descend(team, i, rows, fresh, most, deadline)
    if reached < value - margin * abs(value):
        u[:] = fresh
        return reached, steps
    return value, steps
