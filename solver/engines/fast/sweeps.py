"""Gauss-Seidel sweeps over the team: each robot improves its plan, the others' as they stand.

Small teams whose robots depend on each other take Newton steps on all plans together between
the sweeps. Every accepted step lowers the team's objective and stays inside the hard box, so
the plans are feasible and no worse than the start whenever the sweeps are stopped. A robot
whose own problem nobody has changed since it converged is not visited again.
"""

from math import inf

from solver.engines.fast.clock import is_past
from solver.engines.fast.jit import kernel, merged
from solver.engines.fast.joint import place, read_plans
from solver.engines.fast.layout import Team
from solver.engines.fast.newton import GROUP, TOLERANCE, descend
from solver.engines.fast.pairings import probe_pairs
from solver.engines.fast.probes import (
    HYSTERESIS,
    ROUNDS,
    THOROUGH_TEAM,
    TIRELESS,
    breadth,
    fresh_start,
    rank_starts,
)
from solver.engines.fast.robot import copy_plan, gather, settle
from solver.engines.fast.turns import probe_turns

_SWEEPS = 6
_SMALL_TEAM_SWEEPS = 12
RELATIVE_DECREASE = 1e-6
"""Sweeps end when one lowers the objective by less than this part of it."""

_FIRST_STEPS = 20
_LATER_STEPS = 8
"""Newton steps per visit."""

_PASSES = 2
"""Times that tireless robots look at fresh starts, the later ones where one won."""

_TRIALS = 2
"""Times that several robots together try fresh starts at one step, the later ones where one won.
Further ahead pairs cost half as much again as all the rest, and next to nothing was found."""

_TURNING_TEAM = 8
"""Most robots of a team that tries turned plans: each costs Newton steps of all."""

_JOINT_STEPS = 12
"""Newton steps on all robots' plans together, between two sweeps."""


@merged
def improve(team: Team, objective: float, iterations: int, deadline: float) -> bool:
    """Sweep until converged (True), out of steps, or late."""
    count = team.robots.shape[0]
    # Large teams probe when everybody has a plan; small ones save the second visit.
    probing, sweeps, passes = 1, _SWEEPS, 1
    if count <= THOROUGH_TEAM:
        probing, sweeps = 0, _SMALL_TEAM_SWEEPS
    single = team.setting[0].steps == 1
    if count > 0 and (single or team.robots[0].effort == TIRELESS):
        passes = _PASSES
    trials = _TRIALS if single else 0
    shift = _shift(team)
    for sweep in range(sweeps):
        probes = sweep == probing
        decrease = 0.0
        most = _FIRST_STEPS if sweep == 0 else _LATER_STEPS
        for turn in range(count):
            i = (turn + shift) % count
            robot = team.robots[i]
            looks = probes and robot.curious
            if robot.stale or looks:
                if robot.taken >= iterations or is_past(deadline, team.work[0].timespec):
                    return False
                rounds = ROUNDS if looks else 0
                decrease += visit(team, i, min(most, iterations - robot.taken), rounds, deadline)
        objective -= decrease
        if sweep < probing:
            continue
        converged = decrease <= RELATIVE_DECREASE * objective or _is_fresh(team)
        if not converged and team.work.shape[0] > 1:
            objective, converged = _together(team, iterations, deadline)
        passes -= probes
        if converged and passes > 0 and _jumped(team):
            # Somebody's better valley may have opened one for a mate.
            probing = sweep + 1
        elif converged:
            reached = _together_afresh(team, objective, iterations, deadline, trials)
            if not reached < objective:
                return True
            objective = reached
            trials -= 1
            passes = 1
            probing = sweep + 1
    return _is_fresh(team)


@merged
def _together_afresh(
    team: Team, objective: float, iterations: int, deadline: float, wanted: int
) -> float:
    """Return the objective after fresh starts of several robots, if wanted and possible."""
    if wanted == 0 or team.work.shape[0] == 1:
        return objective
    if team.robots.shape[0] <= _TURNING_TEAM and not team.setting[0].double:
        objective = probe_turns(team, objective, iterations, deadline)
    if team.near.shape[0] > 0:
        objective = probe_pairs(team, objective, iterations, deadline)
    return objective


@kernel
def _jumped(team: Team) -> bool:
    """Return whether a fresh start took any robot's plan's place; forget it."""
    found = False
    for i in range(team.robots.shape[0]):
        found = found or team.robots[i].jumped
        team.robots[i].jumped = False
    return found


@kernel
def _is_fresh(team: Team) -> bool:
    """Return whether every robot has converged and nobody has changed its problem since."""
    fresh = True
    for i in range(team.robots.shape[0]):
        fresh = fresh and not team.robots[i].stale
    return fresh


@merged
def _together(team: Team, iterations: int, deadline: float) -> tuple[float, bool]:
    """Take Newton steps on all plans together; return the objective, whether they converged.

    Where they did not, all robots are to be visited again.
    """
    taken = 0
    u = team.work[1].u
    read_plans(team, u)
    for i in range(team.robots.shape[0]):
        taken = max(taken, team.robots[i].taken)
    most = min(_JOINT_STEPS, iterations - taken)
    _, objective, steps, converged = descend(team, GROUP, 0, u, most, inf, deadline)
    place(team, u)
    for i in range(team.robots.shape[0]):
        team.robots[i].taken += steps
        team.robots[i].stale = not converged
    return objective, converged


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
    improved, later = True, False
    robot.curious = robot.curious and rounds == 0
    copy_plan(team, robot.plan, work.u)
    choices = breadth(robot.effort)
    for attempt in range(1 + choices * rounds):
        if attempt > 0:
            choice = (attempt - 1) % choices
            if choice == 0:
                if not improved:
                    break
                improved = False
                copy_plan(team, work.best, work.base)
                rank_starts(team, i, rows, best, later)
                later = True
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
        if attempt > 0:
            robot.jumped = True
        best, improved = value, True
        copy_plan(team, work.u, work.best)
    if best < first:
        settle(team, i, work.best)
        if first - best > TOLERANCE * first:
            _spoil(team, i)
    return first - best


@merged
def _spoil(team: Team, i: int) -> None:
    """Mark the robots whose own problems contain robot i's plan.

    Where it has jumped they are to look at fresh starts again, too.
    """
    robot = team.robots[i]
    for at in range(robot.sees[0], robot.sees[1]):
        target = team.targets[team.edges[at].target]
        for entry in range(target.watch[0], target.watch[1]):
            other = team.edges[team.watch[entry]].robot
            if other != i:
                _rouse(team, other, robot.jumped)
    for entry in range(robot.near[0], robot.near[1]):
        _rouse(team, team.near[entry], robot.jumped)
    for entry in range(robot.mates[0], robot.mates[1]):
        _rouse(team, team.mates[entry], robot.jumped)
    for entry in range(robot.rows[0], robot.rows[1]):
        _rouse(team, team.rows[entry], robot.jumped)


@kernel
def _rouse(team: Team, i: int, jumped: bool) -> None:
    """Have robot i visited again, since a plan next to it has changed."""
    team.robots[i].stale = True
    team.robots[i].curious = team.robots[i].curious or jumped
