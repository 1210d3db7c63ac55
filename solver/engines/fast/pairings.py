"""Fresh starts for two robots at a time.

Where two robots stand as close as they may, neither can go anywhere alone: one would have to
make room for the other, or both to move on together, and no descent from the plan of either
finds that. So both plans of every such pair are replaced by constant ones, all combinations of
a grid over the box, and the most promising are followed up by Newton steps on both plans
together. Only teams that take such steps do this (`joint.py`).
"""

from solver.arrays import FloatArray
from solver.engines.fast.clock import is_past
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.joint import everybody, place, read_plans
from solver.engines.fast.layout import COARSE, Table, Team
from solver.engines.fast.limits import limits_cost
from solver.engines.fast.newton import GROUP, descend, meets
from solver.engines.fast.probes import (
    CONSTANTS,
    HYSTERESIS,
    forget,
    hold,
    is_valley,
    remember,
)
from solver.engines.fast.robot import copy_plan, cost, gather, settle
from solver.engines.fast.rollout import roll
from solver.engines.fast.separation import discs_cost, nearness, pairs_cost
from solver.engines.fast.tracking import information
from solver.engines.fast.zones import keep_out_cost

_FOLLOWED = 4
"""Combinations of one pair that are followed up."""

_AXES = 4
_COMBINATIONS = CONSTANTS * CONSTANTS
_PRESENT = CONSTANTS
_SLACK = 1.0
"""Combinations dearer than the plans as they stand by more than this part of the objective are
not followed up."""

_CLOSE = 0.02
"""How near the objective, relative to it, a pair must have come for the others to join."""

_STEPS = 12
"""Newton steps on both plans for each of them."""


@kernel
def probe_pairs(team: Team, objective: float, iterations: int, deadline: float) -> float:
    """Look at fresh starts of all pairs that can come too near; return the objective.

    Where it is lower than the one given, all robots are to be visited again.
    """
    joint = team.work[1]
    read_plans(team, joint.kept)
    for i in range(team.robots.shape[0]):
        robot = team.robots[i]
        for entry in range(robot.near[0], robot.near[1]):
            mate = team.near[entry]
            if mate < i:
                continue
            _rank(team, i, mate, _SLACK * abs(objective))
            for slot in range(_FOLLOWED):
                left = iterations - max(robot.taken, team.robots[mate].taken)
                if left <= 0 or is_past(deadline, team.work[0].timespec):
                    return objective
                if joint.choices[slot] >= 0:
                    most = min(_STEPS, left)
                    objective = _follow(team, i, mate, slot, objective, most, deadline)
    return objective


@kernel
def _rank(team: Team, i: int, mate: int, slack: float) -> None:
    """Fill work[1].choices with the best combinations of constant plans, -1 for none.

    What is dearer than the plans as they stand by more than `slack` is none.
    """
    work = team.work[1]
    if _is_jammed(team, i) or _is_jammed(team, mate):
        _price_together(team, i, mate)
    else:
        _price_apart(team, i, mate)
    forget(work, slack)
    for at in range(_COMBINATIONS):
        if is_valley(work.grid, at, COARSE, _AXES):
            remember(work, at, work.grid[at], _FOLLOWED)


@inlined
def _is_jammed(team: Team, i: int) -> bool:
    """Return whether robot i has to do with jamming, which depends on where everybody is."""
    robot = team.robots[i]
    return bool(robot.jams[0] < robot.jams[1] or robot.rows[0] < robot.rows[1])


@kernel
def _price_apart(team: Team, i: int, mate: int) -> None:
    """Fill work[1].grid with what the combinations cost, each plan rolled out once.

    Nothing joins two plans but their separation and the targets that both robots see. Costs are
    relative to those of the plans as they stand, which come after the constant ones.
    """
    setting, work, joint = team.setting[0], team.work[0], team.work[1]
    for member in range(2):
        robot, partner = (i, mate) if member == 0 else (mate, i)
        for number in range(_PRESENT + 1):
            if number < _PRESENT:
                hold(team.robots[robot], COARSE, number, 0, 1, work.u)
            else:
                copy_plan(team, team.robots[robot].plan, work.u)
            roll(team, robot, work.u)
            joint.places[member, number, 0] = work.path[0, 0]
            joint.places[member, number, 1] = work.path[0, 1]
            joint.alone[member, number] = (
                limits_cost(team, robot, work.u)
                + keep_out_cost(team, robot)
                + discs_cost(team, robot)
                + pairs_cost(team, robot, partner)
            )
    for at in range(_COMBINATIONS):
        joint.grid[at] = _apart_price(setting, joint, at // CONSTANTS, at % CONSTANTS)
    joint.stands = _apart_price(setting, joint, _PRESENT, _PRESENT)
    for edge in range(team.robots[i].sees[0], team.robots[i].sees[1]):
        _add_target(team, team.edges[edge].target, i, mate, False)
    for edge in range(team.robots[mate].sees[0], team.robots[mate].sees[1]):
        _add_target(team, team.edges[edge].target, i, mate, True)
    for at in range(_COMBINATIONS):
        joint.grid[at] -= joint.stands


@inlined
def _apart_price(setting: Table, joint: Table, first: int, second: int) -> float:
    """Return what two plans cost without targets."""
    places = joint.places
    dx = places[0, first, 0] - places[1, second, 0]
    dy = places[0, first, 1] - places[1, second, 1]
    return float(joint.alone[0, first] + joint.alone[1, second] + nearness(setting, dx, dy))


@kernel
def _add_target(team: Team, j: int, i: int, mate: int, unshared: bool) -> None:
    """Add target j's trace to the costs, with `unshared` only where robot i does not see it."""
    setting, target, joint = team.setting[0], team.targets[j], team.work[1]
    b0, b1, b2 = target.known[0], target.known[1], target.known[2]
    told, places = joint.told, joint.places
    for member in range(2):
        for number in range(_PRESENT + 1):
            told[member, number, 0] = told[member, number, 1] = told[member, number, 2] = 0.0
    for entry in range(target.watch[0], target.watch[1]):
        edge = team.edges[team.watch[entry]]
        if edge.robot != i and edge.robot != mate:
            b0 += edge.information[0, 0]
            b1 += edge.information[0, 1]
            b2 += edge.information[0, 2]
            continue
        if unshared and edge.robot == i:
            return
        member = 0 if edge.robot == i else 1
        for number in range(_PRESENT + 1):
            told[member, number, 0], told[member, number, 1], told[member, number, 2] = information(
                setting,
                places[member, number, 0] - target.means[0, 0],
                places[member, number, 1] - target.means[0, 1],
            )
    weight = setting.tracking
    for first in range(_PRESENT):
        c0, c1, c2 = b0 + told[0, first, 0], b1 + told[0, first, 1], b2 + told[0, first, 2]
        for second in range(_PRESENT):
            joint.grid[first * CONSTANTS + second] += weight * _trace(c0, c1, c2, told[1, second])
    p = told[0, _PRESENT]
    joint.stands += weight * _trace(b0 + p[0], b1 + p[1], b2 + p[2], told[1, _PRESENT])


@inlined
def _trace(b0: float, b1: float, b2: float, told: FloatArray) -> float:
    """Return tr P for the information of all others and that of one robot."""
    b0, b1, b2 = b0 + told[0], b1 + told[1], b2 + told[2]
    return float((b0 + b2) / (b0 * b2 - b1 * b1))


@kernel
def _price_together(team: Team, i: int, mate: int) -> None:
    """Fill work[1].grid with what the combinations cost, relative to the plans as they stand."""
    u, own, other = team.work[0].u, team.work[0].best, team.work[0].base
    copy_plan(team, team.robots[i].plan, own)
    copy_plan(team, team.robots[mate].plan, other)
    stands = cost(team, mate, gather(team, mate), other)
    for second in range(CONSTANTS):
        hold(team.robots[mate], COARSE, second, 0, 1, u)
        # What only the mate's plan and the rest of the team are concerned with.
        moved = cost(team, mate, gather(team, mate), u) - stands
        settle(team, mate, u)
        rows = gather(team, i)
        moved -= cost(team, i, rows, own)
        for first in range(CONSTANTS):
            hold(team.robots[i], COARSE, first, 0, 1, u)
            price = moved + cost(team, i, rows, u)
            team.work[1].grid[first * CONSTANTS + second] = price
        settle(team, mate, other)


@kernel
def _follow(
    team: Team, i: int, mate: int, slot: int, objective: float, most: int, deadline: float
) -> float:
    """Descend from a combination; keep what comes of it where it is better.

    In a team of more than two the others join where the pair alone has come close to it.
    """
    joint, start = team.work[1], team.work[0].u
    size = 2 * team.setting[0].steps
    joint.members, joint.group[0], joint.group[1] = 2, i, mate
    for member in range(2):
        number = joint.choices[slot]
        number = number // CONSTANTS if member == 0 else number % CONSTANTS
        hold(team.robots[joint.group[member]], COARSE, number, 0, 1, start)
        for at in range(size):
            joint.u[member * size + at] = start[at]
    if team.robots.shape[0] > 2:
        goal = objective + _CLOSE * abs(objective)
        _, value, steps, _ = descend(team, GROUP, 0, joint.u, most, goal, deadline)
        place(team, joint.u)
        team.robots[i].taken += steps
        team.robots[mate].taken += steps
        hopeless = not value < goal or meets(joint, GROUP, joint.u, 2 * size)
        everybody(team)
        if hopeless:
            place(team, joint.kept)
            return objective
        read_plans(team, joint.u)
    return attempt(team, objective, most, deadline)


@kernel
def attempt(team: Team, objective: float, most: int, deadline: float) -> float:
    """Descend from the plans in work[1].u; keep what comes of it where it is better.

    Those to be beaten stand in work[1].kept. Returns the objective.
    """
    joint = team.work[1]
    goal = objective - HYSTERESIS * abs(objective)
    _, value, steps, _ = descend(team, GROUP, 0, joint.u, most, goal, deadline)
    if value < goal:
        objective = value
        for at in range(2 * team.setting[0].steps * team.robots.shape[0]):
            joint.kept[at] = joint.u[at]
    place(team, joint.kept)
    for i in range(team.robots.shape[0]):
        robot = team.robots[i]
        robot.taken += steps
        robot.stale = robot.stale or value < goal
        robot.curious = robot.curious or value < goal
    return objective
