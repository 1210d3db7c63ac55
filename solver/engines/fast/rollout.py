"""Motion over the horizon: plans to paths, and derivatives back from paths to plans."""

from solver.arrays import FloatArray
from solver.engines.fast.jit import inlined, kernel, merged
from solver.engines.fast.layout import Table, Team


@inlined
def roll(team: Team, i: int, u: FloatArray) -> None:
    """Fill path and speeds in the work record with where the controls u (2H,) lead."""
    setting, robot, work = team.setting[0], team.robots[i], team.work[0]
    h = setting.step
    for axis in range(2):
        x = robot.position[axis]
        v = robot.velocity[axis]
        for k in range(setting.steps):
            control = u[2 * k + axis]
            if setting.double:
                x += h * v + 0.5 * h * h * control
                v += h * control
            else:
                x += h * control
                v = control
            work.path[k, axis] = x
            work.speeds[k, axis] = v


@kernel
def pull_back(setting: Table, work: Table) -> None:
    """Turn gradient and Hessian by positions and velocities into those by controls.

    Adds to work.gradient (2H,); transforms work.bend (2H, 2H) in place.
    """
    h, steps, double = setting.step, setting.steps, setting.double
    half = 0.5 * h * h
    for axis in range(2):
        by_x = by_v = 0.0
        for k in range(steps - 1, -1, -1):
            if double:
                by_v += h * by_x + work.speed_slope[k, axis]
            by_x += work.slope[k, axis]
            pulled = half * by_x + h * by_v if double else h * by_x
            work.gradient[2 * k + axis] += pulled
    pull_bend(setting, work)
    if double:
        _add_speed_bend(setting, work)


@kernel
def pull_bend(setting: Table, work: Table) -> None:
    """Turn work.bend (2H, 2H) by two paths into that by the controls that lead along them."""
    bend, h, double = work.bend, setting.step, setting.double
    half = 0.5 * h * h
    size = 2 * setting.steps
    for axis in range(2):
        for column in range(size):
            by_x = by_v = 0.0
            for row in range(size - 2 + axis, -1, -2):
                by_v += h * by_x
                by_x += bend[row, column]
                bend[row, column] = half * by_x + h * by_v if double else h * by_x
    for row in range(size):
        for axis in range(2):
            by_x = by_v = 0.0
            for column in range(size - 2 + axis, -1, -2):
                by_v += h * by_x
                by_x += bend[row, column]
                bend[row, column] = half * by_x + h * by_v if double else h * by_x


@merged
def _add_speed_bend(setting: Table, work: Table) -> None:
    h = setting.step
    for axis in range(2):
        total = 0.0
        for k in range(setting.steps - 1, -1, -1):
            total += h * h * work.speed_bend[k, axis]
            if total == 0.0:
                continue
            at = 2 * k + axis
            work.bend[at, at] += total
            for earlier in range(k):
                before = 2 * earlier + axis
                work.bend[at, before] += total
                work.bend[before, at] += total
