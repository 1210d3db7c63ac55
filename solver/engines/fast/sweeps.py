"""Gauss-Seidel sweeps over the team: each robot improves its plan, the others' as they stand.

Every accepted step lowers the team's objective and stays inside the hard box, so the plans
are feasible and no worse than the start whenever the sweeps are stopped. A robot whose own
problem nobody has changed since it converged is not visited again.
"""

from typing import NamedTuple

from solver.arrays import BoolArray, IntArray
from solver.engines.fast.clock import now
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Team
from solver.engines.fast.newton import TOLERANCE, descend
from solver.engines.fast.probes import HYSTERESIS, probe
from solver.engines.fast.robot import gather, settle

SWEEPS = 6
RELATIVE_DECREASE = 1e-6
"""Sweeps end when one lowers the objective by less than this part of it."""

_FIRST_STEPS = 8
_LATER_STEPS = 3
"""Newton steps per visit."""

_PROBE_STEPS = 8


class Progress(NamedTuple):
    """Where the sweeps stand with each robot."""

    stale: BoolArray
    """(M,) not converged, or its problem has changed since."""

    fresh: BoolArray
    """(M,) wanted: a probe start."""

    replan: BoolArray
    """(M,) a probe start takes the plan's place without hysteresis."""

    steps: IntArray
    """(M,) Newton steps taken."""


@kernel
def improve(
    team: Team, progress: Progress, objective: float, iterations: int, deadline: float
) -> bool:
    """Sweep until converged (True), out of steps, or late."""
    for sweep in range(SWEEPS):
        decrease = 0.0
        most = _FIRST_STEPS if sweep == 0 else _LATER_STEPS
        exhausted = False
        for i in range(progress.stale.shape[0]):
            if progress.stale[i]:
                left = iterations - progress.steps[i]
                if left <= 0 or now(team.scratch.timespec) > deadline:
                    return False
                decrease += visit(team, progress, i, min(most, left), deadline)
            exhausted = exhausted or progress.stale[i]
        objective -= decrease
        if decrease <= RELATIVE_DECREASE * objective:
            return True
    return not exhausted


@kernel
def visit(team: Team, progress: Progress, i: int, most: int, deadline: float) -> float:
    """Improve robot i's plan; return by how much that lowers the team's objective."""
    rows = gather(team, i)
    u = team.scratch.u
    for at in range(u.shape[0]):
        u[at] = team.plans.controls[i, at // 2, at % 2]
    before, value, steps, converged = descend(team, i, rows, u, most, deadline)
    if progress.fresh[i]:
        progress.fresh[i] = False
        margin = 0.0 if progress.replan[i] else HYSTERESIS
        value, more = probe(team, i, rows, value, margin, _PROBE_STEPS, deadline)
        steps += more
    progress.steps[i] += steps
    progress.stale[i] = not converged
    if value < before:
        settle(team, i, u)
        if before - value > TOLERANCE * before:
            _spoil(team, progress, i)
    return before - value


@kernel
def _spoil(team: Team, progress: Progress, i: int) -> None:
    """Mark the robots whose own problems contain robot i's plan."""
    sight, mates, pairs = team.sight, team.mates, team.pairs
    for edge in range(sight.start[i], sight.start[i + 1]):
        j = sight.target[edge]
        for entry in range(sight.watch_start[j], sight.watch_start[j + 1]):
            other = sight.robot[sight.watch[entry]]
            progress.stale[other] = progress.stale[other] or other != i
    for edge in range(pairs.start[i], pairs.start[i + 1]):
        progress.stale[pairs.mate[edge]] = True
    for edge in range(mates.start[i], mates.start[i + 1]):
        progress.stale[mates.mate[edge]] = True
    for edge in range(mates.row_start[i], mates.row_start[i + 1]):
        progress.stale[mates.row[edge]] = True
