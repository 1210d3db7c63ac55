"""The problem of a group as one: the controls of all robots, or of a pair, for small teams.

Sweeps over the robots converge slowly where two of them see one target from close by: each
answers the other's last move. Newton steps on all controls together do not. The gradient and
the diagonal blocks are those of the robots' own problems; the blocks between two robots hold
what they tell of the same targets and their separation. Jamming couples them too, but only
through the farthest mate, and is left to the sweeps: it costs iterations, not correctness.
"""

from math import sqrt

from solver.arrays import FloatArray
from solver.engines.fast.glimpse import add_joint_glimpse
from solver.engines.fast.hinges import bears
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Team
from solver.engines.fast.robot import expand, gather, settle, team_cost
from solver.engines.fast.rollout import pull_bend
from solver.engines.fast.tracking import add_joint_tracking


@kernel
def everybody(team: Team) -> None:
    """Make the whole team the group."""
    joint = team.work[1]
    joint.members = team.robots.shape[0]
    for i in range(joint.members):
        joint.group[i] = i


@kernel
def place(team: Team, u: FloatArray) -> None:
    """Make u (2H members,) the group's plans."""
    joint, plan = team.work[1], team.work[0].u
    size = 2 * team.setting[0].steps
    for member in range(joint.members):
        i = joint.group[member]
        stands = True
        for at in range(size):
            plan[at] = u[member * size + at]
            stands = stands and plan[at] == team.robots[i].plan[at]
        if not stands:
            settle(team, i, plan)


@kernel
def read_plans(team: Team, u: FloatArray) -> None:
    """Fill u (2H members,) with the group's plans as they stand."""
    joint = team.work[1]
    size = 2 * team.setting[0].steps
    for member in range(joint.members):
        plan = team.robots[joint.group[member]].plan
        for at in range(size):
            u[member * size + at] = plan[at]


@kernel
def joint_cost(team: Team, u: FloatArray) -> float:
    """Return the team's objective for the controls u (2H members,), which become the plans."""
    place(team, u)
    return team_cost(team)


@kernel
def expand_joint(team: Team) -> None:
    """Fill gradient and Hessian of the team's objective by the group's plans as they stand."""
    work, joint = team.work[0], team.work[1]
    size = 2 * team.setting[0].steps
    for member in range(joint.members):
        i = joint.group[member]
        expand(team, i, gather(team, i), team.robots[i].plan)
        for at in range(size):
            joint.gradient[member * size + at] = work.gradient[at]
        _store(team, member, member)
        for other in range(member):
            _expand_pair(team, i, joint.group[other])
            _store(team, member, other)


@inlined
def _store(team: Team, member: int, other: int) -> None:
    """Copy work.bend to its place and its mirror image's in the group's Hessian."""
    bend, joint = team.work[0].bend, team.work[1].bend
    size = 2 * team.setting[0].steps
    for row in range(size):
        for column in range(size):
            joint[member * size + row, other * size + column] = bend[row, column]
            joint[other * size + column, member * size + row] = bend[row, column]


@inlined
def _expand_pair(team: Team, i: int, mate: int) -> None:
    """Fill work.bend with the block between robot i, which was expanded last, and a mate."""
    robot, bend = team.robots[i], team.work[0].bend
    size = 2 * team.setting[0].steps
    for row in range(size):
        for column in range(size):
            bend[row, column] = 0.0
    coupled = False
    for at in range(robot.sees[0], robot.sees[1]):
        watch = team.targets[team.edges[at].target].watch
        for entry in range(watch[0], watch[1]):
            other = team.watch[entry]
            if team.edges[other].robot == mate:
                if size == 2:
                    add_joint_glimpse(team, at, other)
                else:
                    add_joint_tracking(team, at, mate)
                coupled = True
    for entry in range(robot.near[0], robot.near[1]):
        if team.near[entry] == mate:
            _add_pair_separation(team, i, mate)
            coupled = True
    if coupled:
        pull_bend(team.setting[0], team.work[0])


@inlined
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
