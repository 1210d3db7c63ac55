"""One robot's own problem: everything of the team's objective that its plan changes.

The other robots' plans are fixed. What depends on them alone is gathered once per visit;
what is left out is constant in the robot's own controls (2H,).
"""

from solver.arrays import FloatArray
from solver.engines.fast.glimpse import add_glimpse
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Team
from solver.engines.fast.limits import add_limits, limits_cost
from solver.engines.fast.rollout import pull_back, roll
from solver.engines.fast.rows import add_rows, gather_rows, rows_cost
from solver.engines.fast.separation import NOBODY, add_separation, discs_cost, pairs_cost
from solver.engines.fast.spread import add_jamming, jamming_cost, refresh_clearance
from solver.engines.fast.tracking import (
    add_tracking,
    gather_information,
    refresh_information,
    team_trace,
    trace,
)
from solver.engines.fast.zones import add_keep_out, keep_out_cost


@kernel
def gather(team: Team, i: int) -> int:
    """Collect what the other robots fix in robot i's problem, return the number of rows."""
    gather_information(team, i)
    robot = team.robots[i]
    return gather_rows(team, i) if robot.rows[0] < robot.rows[1] else 0


@kernel
def cost(team: Team, i: int, rows: int, u: FloatArray) -> float:
    """Return robot i's cost for the controls u (2H,)."""
    robot = team.robots[i]
    roll(team, i, u)
    traces = 0.0
    for at in range(robot.sees[0], robot.sees[1]):
        traces += trace(team, at)
    total = limits_cost(team, i, u) + keep_out_cost(team, i)
    total += pairs_cost(team, i, NOBODY) + discs_cost(team, i)
    if robot.jams[0] < robot.jams[1]:
        total += jamming_cost(team, i)
    if rows > 0:
        total += rows_cost(team, rows)
    return total + float(team.setting[0].tracking) * traces


@kernel
def expand(team: Team, i: int, rows: int, u: FloatArray) -> float:
    """Fill gradient (2H,) and Hessian (2H, 2H) of robot i's cost at u, return the cost."""
    robot, work, effort = team.robots[i], team.work[0], team.setting[0].effort
    roll(team, i, u)
    size = 2 * team.setting[0].steps
    for row in range(size):
        work.slope[row // 2, row % 2] = 0.0
        work.gradient[row] = 2.0 * effort * u[row]
        for column in range(size):
            work.bend[row, column] = 0.0
    total = limits_cost(team, i, u)
    add_limits(team, i)
    for at in range(robot.sees[0], robot.sees[1]):
        total += add_glimpse(team, at) if size == 2 else add_tracking(team, at)
    total += add_keep_out(team, i) + add_separation(team, i)
    if robot.jams[0] < robot.jams[1]:
        total += add_jamming(team, i)
    if rows > 0:
        total += add_rows(team, rows)
    pull_back(team.setting[0], work)
    for at in range(size):
        work.bend[at, at] += 2.0 * effort
    return total


@kernel
def settle(team: Team, i: int, u: FloatArray) -> None:
    """Make u (2H,) robot i's plan, and refresh what the others read of it."""
    robot, path = team.robots[i], team.work[0].path
    roll(team, i, u)
    for k in range(team.setting[0].steps):
        for axis in range(2):
            robot.plan[2 * k + axis] = u[2 * k + axis]
            robot.path[k, axis] = path[k, axis]
    refresh_information(team, i)
    refresh_clearance(team, i)


@kernel
def copy_plan(team: Team, source: FloatArray, target: FloatArray) -> None:
    """Fill target (2H,) with the controls in source."""
    for at in range(2 * team.setting[0].steps):
        target[at] = source[at]


@kernel
def team_cost(team: Team) -> float:
    """Return the objective of the whole team at its plans."""
    traces = 0.0
    for j in range(team.targets.shape[0]):
        traces += team_trace(team, j)
    total = team.setting[0].tracking * traces
    for i in range(team.robots.shape[0]):
        plan = team.robots[i].plan
        roll(team, i, plan)
        total += limits_cost(team, i, plan) + keep_out_cost(team, i)
        total += 0.5 * pairs_cost(team, i, NOBODY) + discs_cost(team, i)
        if team.robots[i].jams[0] < team.robots[i].jams[1]:
            total += jamming_cost(team, i)
    return float(total)
