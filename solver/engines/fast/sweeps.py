"""Gauss-Seidel sweeps over the team: each robot improves its plan, the others' as they stand.

Every accepted step lowers the team's objective and stays inside the hard box, so the plans
are feasible and no worse than the start whenever the sweeps are stopped. A robot whose own
problem nobody has changed since it converged is not visited again.
"""

from solver.arrays import FloatArray
from solver.engines.fast.clock import now
from solver.engines.fast.jit import kernel, merged
from solver.engines.fast.layout import CHOICES, Team
from solver.engines.fast.newton import TOLERANCE, descend
from solver.engines.fast.probes import HYSTERESIS, fresh_start, rank_starts
from solver.engines.fast.robot import gather, settle

SWEEPS = 6
RELATIVE_DECREASE = 1e-6
"""Sweeps end when one lowers the objective by less than this part of it."""

_FIRST_STEPS = 8
_LATER_STEPS = 3
"""Newton steps per visit."""


@merged
def improve(team: Team, objective: float, iterations: int, deadline: float) -> bool:
    """Sweep until converged (True), out of steps, or late."""
    for sweep in range(SWEEPS):
        decrease = 0.0
        most = _FIRST_STEPS if sweep == 0 else _LATER_STEPS
        stale = False
        for i in range(team.robots.shape[0]):
            robot = team.robots[i]
            if robot.stale:
                if robot.taken >= iterations or now(team.work[0].timespec) > deadline:
                    return False
                decrease += visit(team, i, min(most, iterations - robot.taken), deadline)
            stale = stale or robot.stale
        objective -= decrease
        if decrease <= RELATIVE_DECREASE * objective:
            return True
    return not stale


@merged
def visit(team: Team, i: int, most: int, deadline: float) -> float:
    """Improve robot i's plan; return by how much that lowers the team's objective.

    The first attempt goes on from the plan, the others are probe starts in rounds.
    """
    robot, work = team.robots[i], team.work[0]
    rows = gather(team, i)
    best = first = 0.0
    improved = True
    _copy(team, robot.plan, work.u)
    for attempt in range(1 + CHOICES * robot.rounds):
        if attempt > 0:
            choice = (attempt - 1) % CHOICES
            if choice == 0:
                if not improved:
                    break
                improved = False
                _copy(team, work.best, work.base)
                rank_starts(team, i, rows)
            if work.choices[choice] < 0:
                continue
            fresh_start(team, i, work.choices[choice], work.u)
        before, value, steps, converged = descend(team, i, rows, work.u, most, deadline)
        robot.taken += steps
        if attempt == 0:
            first = before
            robot.stale = not converged
        elif not value < best - (0.0 if robot.replan else HYSTERESIS) * abs(best):
            continue
        best, improved = value, True
        _copy(team, work.u, work.best)
    robot.rounds = 0
    if best < first:
        settle(team, i, work.best)
        if first - best > TOLERANCE * first:
            _spoil(team, i)
    return first - best


@kernel
def _copy(team: Team, source: FloatArray, target: FloatArray) -> None:
    for at in range(2 * team.setting[0].steps):
        target[at] = source[at]


@merged
def _spoil(team: Team, i: int) -> None:
    """Mark the robots whose own problems contain robot i's plan."""
    robot = team.robots[i]
    for at in range(robot.sees[0], robot.sees[1]):
        target = team.targets[team.edges[at].target]
        for entry in range(target.watch[0], target.watch[1]):
            other = team.edges[team.watch[entry]].robot
            if other != i:
                team.robots[other].stale = True
    for entry in range(robot.near[0], robot.near[1]):
        team.robots[team.near[entry]].stale = True
    for entry in range(robot.mates[0], robot.mates[1]):
        team.robots[team.mates[entry]].stale = True
    for entry in range(robot.rows[0], robot.rows[1]):
        team.robots[team.rows[entry]].stale = True
