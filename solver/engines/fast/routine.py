"""The whole solve as one function of plain arrays: what is compiled ahead and cached."""

import numpy as np

from solver.arrays import FloatArray
from solver.engines.fast.jit import kernel, merged
from solver.engines.fast.joint import everybody
from solver.engines.fast.layout import Team
from solver.engines.fast.request import Hazards, Movement, Safety, Start, Targets
from solver.engines.fast.robot import settle, team_cost
from solver.engines.fast.rollout import roll
from solver.engines.fast.sweeps import improve
from solver.engines.fast.tables import assemble

Answer = tuple[FloatArray, float, int, bool]


def routine(
    movement: Movement,
    targets: Targets,
    sensing: Hazards,
    communication: Hazards,
    safety: Safety,
    start: Start,
) -> Answer:
    """Minimise the team's objective.

    Returns:
        Controls, positions and velocities (3, M, H, 2); the objective; Newton steps of the robot
        that took most; whether it converged.
    """
    team = assemble(movement, targets, sensing, communication, safety, start)
    begin(team, start.previous)
    converged = improve(team, team_cost(team), start.iterations, start.deadline)
    plans = np.empty((3, team.robots.shape[0], team.setting[0].steps, 2))
    most = _read_plans(team, plans)
    return plans, team_cost(team), most, converged


@merged
def begin(team: Team, previous: FloatArray) -> None:
    """Start from the last plan moved into the box, or from rest."""
    u = team.work[0].u
    for i in range(team.robots.shape[0]):
        robot = team.robots[i]
        for at in range(2 * team.setting[0].steps):
            value = 0.0
            if previous.shape[0] > 0:
                value = previous[i, at // 2, at % 2]
            u[at] = min(max(value, robot.lower[at]), robot.upper[at])
        settle(team, i, u)
    if team.work.shape[0] > 1:
        everybody(team)


@kernel
def _read_plans(team: Team, plans: FloatArray) -> int:
    """Copy the plans out; return the Newton steps of the robot that took most."""
    most = 0
    for i in range(team.robots.shape[0]):
        robot, work = team.robots[i], team.work[0]
        roll(team, i, robot.plan)
        for k in range(team.setting[0].steps):
            for axis in range(2):
                plans[0, i, k, axis] = robot.plan[2 * k + axis]
                plans[1, i, k, axis] = work.path[k, axis]
                plans[2, i, k, axis] = work.speeds[k, axis]
        most = max(most, robot.taken)
    return most
