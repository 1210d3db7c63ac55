"""Fresh starts for a team one of whose robots goes to the other side of a target.

Seen from close by, a target has two sides that tell the same of it. With its mates' plans as they
are a robot may find the other one dearer: they keep as near to it as jamming asks for, and look
from where it does not. So its plan turned by half a circle is followed up by Newton steps on
all plans together. Only teams that take such steps do this, at one step, and only those of single
integrators.
"""

from solver.engines.fast.clock import is_past
from solver.engines.fast.jit import kernel
from solver.engines.fast.joint import read_plans
from solver.engines.fast.layout import Team
from solver.engines.fast.pairings import attempt
from solver.engines.fast.probes import turned_plan
from solver.engines.fast.robot import copy_plan, cost, gather

_SLACK = 0.1
"""Turned plans dearer than the plan by more than this part of the objective are not followed up."""

_STEPS = 12
"""Newton steps on all plans for each of them."""

_HALF = 2
"""Quarters of a circle."""


@kernel
def probe_turns(team: Team, objective: float, iterations: int, deadline: float) -> float:
    """Look at every robot's plan turned about each target close to it; return the objective.

    Where it is lower than the one given, all robots are to be visited again.
    """
    work, joint = team.work[0], team.work[1]
    size = 2 * team.setting[0].steps
    read_plans(team, joint.kept)
    for i in range(team.robots.shape[0]):
        robot = team.robots[i]
        for at in range(robot.sees[0], robot.sees[1]):
            left = iterations - robot.taken
            if left <= 0 or is_past(deadline, work.timespec):
                return objective
            copy_plan(team, robot.plan, work.base)
            if not turned_plan(team, i, team.edges[at].target, 0, _HALF, 0, work.u):
                continue
            rows = gather(team, i)
            dearer = cost(team, i, rows, work.u) - cost(team, i, rows, work.base)
            if dearer < _SLACK * abs(objective):
                read_plans(team, joint.u)
                for axis in range(size):
                    joint.u[i * size + axis] = work.u[axis]
                objective = attempt(team, objective, min(_STEPS, left), deadline)
    return objective
