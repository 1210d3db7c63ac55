"""Fresh starts for two robots at a time.

Where two robots stand as close as they may, neither can go anywhere alone: one would have to
make room for the other, or both to move on together, and no descent from the plan of either
finds that. So both plans of every such pair are replaced by constant ones, all combinations of
a grid over the box, and the most promising are followed up by Newton steps on all plans
together. Only teams that take such steps do this (`joint.py`).
"""

from math import inf

from solver.engines.fast.clock import now
from solver.engines.fast.jit import kernel
from solver.engines.fast.joint import place, read_plans
from solver.engines.fast.layout import COARSE, Team
from solver.engines.fast.newton import WHOLE_TEAM, descend
from solver.engines.fast.probes import (
    CONSTANTS,
    HYSTERESIS,
    forget,
    hold,
    is_valley,
    remember,
)
from solver.engines.fast.robot import copy_plan, cost, gather, settle

_FOLLOWED = 4
"""Combinations of one pair that are followed up."""

_AXES = 4
_COMBINATIONS = CONSTANTS * CONSTANTS
_STEPS = 12
"""Newton steps on all plans for each of them."""


@kernel
def probe_pairs(team: Team, objective: float, iterations: int, deadline: float) -> float:
    """Look at fresh starts of all pairs that can come too near; return the objective.

    Where it is lower than the one given, all robots are to be visited again.
    """
    kept = team.work[1].kept
    read_plans(team, kept)
    for i in range(team.robots.shape[0]):
        robot = team.robots[i]
        for entry in range(robot.near[0], robot.near[1]):
            mate = team.near[entry]
            if mate < i:
                continue
            _rank(team, i, mate)
            for slot in range(_FOLLOWED):
                left = iterations - max(robot.taken, team.robots[mate].taken)
                if left <= 0 or now(team.work[0].timespec) > deadline:
                    return objective
                combination = team.work[1].choices[slot]
                if combination >= 0:
                    most = min(_STEPS, left)
                    objective = _follow(team, i, mate, combination, objective, most, deadline)
    return objective


@kernel
def _rank(team: Team, i: int, mate: int) -> None:
    """Fill work[1].choices with the best combinations of constant plans, -1 for none."""
    work = team.work[1]
    _price(team, i, mate)
    forget(work, inf)
    for at in range(_COMBINATIONS):
        if is_valley(work.grid, at, COARSE, _AXES):
            remember(work, at, work.grid[at], _FOLLOWED)


@kernel
def _price(team: Team, i: int, mate: int) -> None:
    """Fill work[1].grid with what the combinations cost, relative to the plans as they stand."""
    u, own, other = team.work[0].u, team.work[0].best, team.work[0].base
    copy_plan(team, team.robots[i].plan, own)
    copy_plan(team, team.robots[mate].plan, other)
    stands = cost(team, mate, gather(team, mate), other)
    for second in range(CONSTANTS):
        hold(team, mate, COARSE, second, 0, u)
        # What only the mate's plan and the rest of the team are concerned with.
        moved = cost(team, mate, gather(team, mate), u) - stands
        settle(team, mate, u)
        rows = gather(team, i)
        moved -= cost(team, i, rows, own)
        for first in range(CONSTANTS):
            hold(team, i, COARSE, first, 0, u)
            price = moved + cost(team, i, rows, u)
            team.work[1].grid[first * CONSTANTS + second] = price
        settle(team, mate, other)


@kernel
def _follow(
    team: Team,
    i: int,
    mate: int,
    combination: int,
    objective: float,
    most: int,
    deadline: float,
) -> float:
    """Descend from a combination; keep what comes of it where it is better."""
    u, kept = team.work[1].u, team.work[1].kept
    size = 2 * team.setting[0].steps
    count = size * team.robots.shape[0]
    for at in range(count):
        u[at] = kept[at]
    hold(team, i, COARSE, combination // CONSTANTS, 0, team.work[0].u)
    for at in range(size):
        u[i * size + at] = team.work[0].u[at]
    hold(team, mate, COARSE, combination % CONSTANTS, 0, team.work[0].u)
    for at in range(size):
        u[mate * size + at] = team.work[0].u[at]
    goal = objective - HYSTERESIS * abs(objective)
    _, value, steps, _ = descend(team, WHOLE_TEAM, 0, u, most, goal, deadline)
    team.robots[i].taken += steps
    team.robots[mate].taken += steps
    if not value < goal:
        place(team, kept)
        return objective
    place(team, u)
    for at in range(count):
        kept[at] = u[at]
    for robot in range(team.robots.shape[0]):
        team.robots[robot].stale = team.robots[robot].curious = True
    return value
