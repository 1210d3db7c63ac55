"""Where a step failed: what it would have run into.

The paths' change by the whole step is kept with the robots while derivatives are taken once
more; hinges that it closes then count as closed (`hinges.py`). In contact, between two robots
or at a zone, one step aimed so does the work of some ten damped ones.
"""

from solver.arrays import FloatArray
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Table, Team
from solver.engines.fast.rollout import roll


@kernel
def note_shift(team: Team, i: int, work: Table, u: FloatArray, first: int) -> None:
    """Keep with robot i how its path changes by the step from u, its controls from `first` on."""
    scratch, robot, path = team.work[0].vector, team.robots[i], team.work[0].path
    size = 2 * team.setting[0].steps
    for at in range(size):
        scratch[at] = u[first + at]
    roll(team, i, scratch)
    for k in range(team.setting[0].steps):
        for axis in range(2):
            robot.shift[k, axis] = -path[k, axis]
    for at in range(size):
        value = u[first + at] + work.direction[first + at]
        scratch[at] = min(max(value, work.lower[first + at]), work.upper[first + at])
    roll(team, i, scratch)
    for k in range(team.setting[0].steps):
        for axis in range(2):
            robot.shift[k, axis] += path[k, axis]


@kernel
def forget_shift(team: Team, i: int) -> None:
    """Forget it: derivatives are those of the cost again."""
    shift = team.robots[i].shift
    for k in range(team.setting[0].steps):
        shift[k, 0] = shift[k, 1] = 0.0
