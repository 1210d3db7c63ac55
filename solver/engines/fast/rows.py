"""The jamming rows of team mates in a robot's own problem (see `spread.py`)."""

from math import exp, log

from solver.engines.fast.hinges import add_hinge
from solver.engines.fast.jit import inlined, kernel
from solver.engines.fast.layout import Table, Team
from solver.engines.fast.separation import apart
from solver.engines.fast.spread import NEGLIGIBLE, measure, weigh


@kernel
def gather_rows(team: Team, i: int) -> int:
    """List in team.binding the mates' rows (l, k) that robot i can change; return how many.

    The rest of each row's soft maximum is computed once, from the other mates themselves:
    taking robot i's share out of a stored sum would cancel where it is the farthest.
    """
    setting, robot = team.setting[0], team.robots[i]
    count = 0
    for entry in range(robot.rows[0], robot.rows[1]):
        index = team.rows[entry]
        mate = team.robots[index]
        others = mate.mates[1] - mate.mates[0] - 1
        slack = setting.blend * log(others + 1)
        for k in range(setting.steps):
            x, y = mate.path[k, 0], mate.path[k, 1]
            most = apart(x - robot.position[0], y - robot.position[1], setting.smooth)
            most += robot.reach + setting.smooth
            rest = measure(team, index, k, x, y, i)
            if most < rest - NEGLIGIBLE * setting.blend:
                continue
            if _can_bind(team, mate, k, max(most, rest) + slack):
                row = team.binding[count]
                row.robot, row.step, row.rest = index, k, rest
                row.sum = weigh(team, others, rest)
                count += 1
    return count


@kernel
def _can_bind(team: Team, mate: Table, k: int, spread: float) -> bool:
    """Return whether any of the mate's zones binds at step k for this spread."""
    for entry in range(mate.jams[0], mate.jams[1]):
        jam = team.jams[entry]
        if jam.clearance[k] < team.jam_zones[jam.zone].margin * spread:
            return True
    return False


@inlined
def _row_spread(row: Table, length: float, blend: float) -> tuple[float, float]:
    """Return the mate's soft maximum and robot i's weight in it."""
    if row.sum == 0.0:
        return length, 1.0
    farthest = max(row.rest, length)
    mine = exp((length - farthest) / blend)
    total = row.sum * exp((row.rest - farthest) / blend) + mine
    return farthest + blend * log(total), mine / total


@kernel
def rows_cost(team: Team, count: int) -> float:
    """Return the weighted squared hinges of the listed rows for robot i on work.path."""
    setting, path = team.setting[0], team.work[0].path
    total = 0.0
    for at in range(count):
        row = team.binding[at]
        mate, k = team.robots[row.robot], row.step
        length = apart(path[k, 0] - mate.path[k, 0], path[k, 1] - mate.path[k, 1], setting.smooth)
        spread, _ = _row_spread(row, length, setting.blend)
        for entry in range(mate.jams[0], mate.jams[1]):
            jam = team.jams[entry]
            zone = team.jam_zones[jam.zone]
            gap = jam.clearance[k] - zone.margin * spread
            if gap < 0.0:
                total += zone.weight * gap * gap
    return total


@kernel
def add_rows(team: Team, count: int) -> float:
    """Add the derivatives of the same by robot i's path, return it."""
    setting, work = team.setting[0], team.work[0]
    total = 0.0
    for at in range(count):
        row = team.binding[at]
        mate, k = team.robots[row.robot], row.step
        dx = work.path[k, 0] - mate.path[k, 0]
        dy = work.path[k, 1] - mate.path[k, 1]
        length = apart(dx, dy, setting.smooth)
        spread, share = _row_spread(row, length, setting.blend)
        length += setting.smooth
        dx /= length
        dy /= length
        along = share * (1.0 - share) / setting.blend
        across = share / length
        xx = across * (1.0 - dx * dx) + along * dx * dx
        xy = (along - across) * dx * dy
        yy = across * (1.0 - dy * dy) + along * dy * dy
        for entry in range(mate.jams[0], mate.jams[1]):
            jam = team.jams[entry]
            zone = team.jam_zones[jam.zone]
            less = -zone.margin
            gap = jam.clearance[k] + less * spread
            if gap < 0.0:
                total += zone.weight * gap * gap
                twice, pull = 2.0 * zone.weight, less * share
                add_hinge(
                    work, k, twice, gap, pull * dx, pull * dy, less * xx, less * xy, less * yy
                )
    return total
