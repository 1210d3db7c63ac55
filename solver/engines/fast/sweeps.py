"""Gauss-Seidel sweeps over the team: each robot improves its plan, the others' as they stand.

Every accepted step lowers the team's objective and stays inside the hard box, so the plans
are feasible and no worse than the start whenever the sweeps are stopped. A robot whose own
problem nobody has changed since it converged is not visited again.
"""

from math import inf

from solver.arrays import FloatArray
from solver.engines.fast.clock import now
from solver.engines.fast.jit import kernel, merged
from solver.engines.fast.layout import CHOICES, Team
from solver.engines.fast.newton import TOLERANCE, descend
from solver.engines.fast.probes import (
    HYSTERESIS,
    ROUNDS,
    THOROUGH_TEAM,
    fresh_start,
    rank_starts,
)
from solver.engines.fast.robot import gather, settle

_SWEEPS = 6
_SMALL_TEAM_SWEEPS = 12
RELATIVE_DECREASE = 1e-6
"""Sweeps end when one lowers the objective by less than this part of it."""

_FIRST_STEPS = 20
_LATER_STEPS = 8
"""Newton steps per visit."""


@merged
def improve(team: Team, objective: float, iterations: int, deadline: float) -> bool:
    """Sweep until converged (True), out of steps, or late."""
    count = team.robots.shape[0]
    # Large teams probe when everybody has a plan; small ones save the second visit.
    probing, sweeps = 1, _SWEEPS
    if count <= THOROUGH_TEAM:
        probing, sweeps = 0, _SMALL_TEAM_SWEEPS
    shift = _shift(team)
    for sweep in range(sweeps):
        decrease = 0.0
        most = _FIRST_STEPS if sweep == 0 else _LATER_STEPS
        stale = False
        for turn in range(count):
            i = (turn + shift) % count
            robot = team.robots[i]
            if robot.stale or sweep == probing:
                if robot.taken >= iterations or now(team.work[0].timespec) > deadline:
                    return False
                rounds = ROUNDS if sweep == probing else 0
                decrease += visit(team, i, min(most, iterations - robot.taken), rounds, deadline)
            stale = stale or robot.stale
        objective -= decrease
        if sweep >= probing and decrease <= RELATIVE_DECREASE * objective:
            return True
    return not stale


@kernel
def _shift(team: Team) -> int:
    """Return whose turn is first: another robot's from tick to tick.

    So nobody is always the last one when time runs out. It hangs on where the robots are,
    for an engine remembers nothing and the same problem must give the same plan.
    """
    place = 0.0
    for i in range(team.robots.shape[0]):
        place += abs(team.robots[i].position[0]) + abs(team.robots[i].position[1])
    shift: int = int(min(place, 1e6) * 1e6) % max(team.robots.shape[0], 1)
    return shift


@merged
def visit(team: Team, i: int, most: int, rounds: int, deadline: float) -> float:
    """Improve robot i's plan; return by how much that lowers the team's objective.

    The first attempt goes on from the plan, the others are `rounds` rounds of probe starts.
    """
    robot, work = team.robots[i], team.work[0]
    rows = gather(team, i)
    first, best = 0.0, inf
    improved = True
    _copy(team, robot.plan, work.u)
    breadth = CHOICES if robot.thorough else 1
    for attempt in range(1 + breadth * rounds):
        if attempt > 0:
            choice = (attempt - 1) % breadth
            if choice == 0:
                if not improved:
                    break
                improved = False
                _copy(team, work.best, work.base)
                rank_starts(team, i, rows, best)
            if work.choices[choice] < 0:
                continue
            fresh_start(team, i, work.choices[choice], work.u)
        before, value, steps, converged = descend(team, i, rows, work.u, most, best, deadline)
        robot.taken += steps
        if attempt == 0:
            first = before
            robot.stale = not converged
        elif not value < best - (0.0 if robot.replan else HYSTERESIS) * abs(best):
            continue
        best, improved = value, True
        _copy(team, work.u, work.best)
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
