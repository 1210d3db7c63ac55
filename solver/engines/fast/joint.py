"""The team's problem as one: all robots' controls together, for small teams.

Sweeps over the robots converge slowly where two of them see one target from close by: each
answers the other's last move. Newton steps on all controls together do not. The gradient and
the diagonal blocks are those of the robots' own problems; the blocks between two robots hold
what they tell of the same targets and their separation. Jamming couples them too, but only
through the farthest mate, and is left to the sweeps: it costs iterations, not correctness.
"""

from math import sqrt

from solver.arrays import FloatArray
from solver.engines.fast.hinges import bears
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import Team
from solver.engines.fast.robot import expand, gather, settle, team_cost
from solver.engines.fast.rollout import pull_bend
from solver.engines.fast.tracking import add_joint_tracking


@kernel
def place(team: Team, u: FloatArray) -> None:
    """Make u (2HM,) the plans of all robots."""
    size = 2 * team.setting[0].steps
    plan = team.work[0].u
    for i in range(team.robots.shape[0]):
        for at in range(size):
            plan[at] = u[i * size + at]
        settle(team, i, plan)


@kernel
def read_plans(team: Team, u: FloatArray) -> None:
    """Fill u (2HM,) with the plans as they stand."""
    size = 2 * team.setting[0].steps
    for i in range(team.robots.shape[0]):
        for at in range(size):
            u[i * size + at] = team.robots[i].plan[at]


@kernel
def joint_cost(team: Team, u: FloatArray) -> float:
    """Return the team's objective for the controls u (2HM,), which become the plans."""
    place(team, u)
    return team_cost(team)


@kernel
def expand_joint(team: Team, u: FloatArray) -> float:
    """Fill gradient and Hessian of the team's objective at u, return the objective."""
    work, joint = team.work[0], team.work[1]
    size = 2 * team.setting[0].steps
    value = joint_cost(team, u)
    for i in range(team.robots.shape[0]):
        expand(team, i, gather(team, i), team.robots[i].plan)
        for at in range(size):
            joint.gradient[i * size + at] = work.gradient[at]
        _store(team, i, i)
        for mate in range(i):
            _expand_pair(team, i, mate)
            _store(team, i, mate)
    return value


@kernel
def _store(team: Team, i: int, mate: int) -> None:
    """Copy work.bend to its place and its mirror image's in the team's Hessian."""
    bend, joint = team.work[0].bend, team.work[1].bend
    size = 2 * team.setting[0].steps
    for row in range(size):
        for column in range(size):
            joint[i * size + row, mate * size + column] = bend[row, column]
            joint[mate * size + column, i * size + row] = bend[row, column]


@kernel
def _expand_pair(team: Team, i: int, mate: int) -> None:
    """Fill work.bend with the block between robot i, which was expanded last, and a mate."""
    robot, bend = team.robots[i], team.work[0].bend
    size = 2 * team.setting[0].steps
    for row in range(size):
        for column in range(size):
            bend[row, column] = 0.0
    coupled = False
    for at in range(robot.sees[0], robot.sees[1]):
        j = team.edges[at].target
        watch = team.targets[j].watch
        for entry in range(watch[0], watch[1]):
            if team.edges[team.watch[entry]].robot == mate:
                add_joint_tracking(team, j, at - robot.sees[0], mate)
                coupled = True
    for entry in range(robot.near[0], robot.near[1]):
        if team.near[entry] == mate:
            _add_pair_separation(team, i, mate)
            coupled = True
    if coupled:
        pull_bend(team)


@kernel
def _add_pair_separation(team: Team, i: int, mate: int) -> None:
    """Subtract the pair's separation hinges: their Hessian between two robots is minus the own."""
    setting, work, bend = team.setting[0], team.work[0], team.work[0].bend
    path, other = team.robots[i].path, team.robots[mate].path
    shift, shifted = team.robots[i].shift, team.robots[mate].shift
    smooth = setting.smooth
    for k in range(setting.steps):
        dx, dy = path[k, 0] - other[k, 0], path[k, 1] - other[k, 1]
        length = sqrt(dx * dx + dy * dy + smooth * smooth)
        gap = length - smooth - setting.distance
        gx, gy = dx / length, dy / length
        change = gx * (shift[k, 0] - shifted[k, 0]) + gy * (shift[k, 1] - shifted[k, 1])
        if bears(work, gap, change):
            twice = 2.0 * setting.separation
            across = gap / length
            bend[2 * k, 2 * k] -= twice * (gx * gx + across * (1.0 - gx * gx))
            mixed = twice * (1.0 - across) * gx * gy
            bend[2 * k, 2 * k + 1] -= mixed
            bend[2 * k + 1, 2 * k] -= mixed
            bend[2 * k + 1, 2 * k + 1] -= twice * (gy * gy + across * (1.0 - gy * gy))
