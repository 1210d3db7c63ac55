"""From the request's plain arrays to the tables the kernels work on."""

import numpy as np

from solver.engines.fast.box import fill_box, fill_reach
from solver.engines.fast.jit import kernel, maker, merged
from solver.engines.fast.layout import (
    MAX_JOINT,
    ROBOT,
    ROW,
    SETTING,
    TARGET,
    WORK,
    ZONE,
    Table,
    Team,
)
from solver.engines.fast.lists import (
    disc_list,
    jam_list,
    keep_list,
    mate_list,
    near_list,
    row_list,
    sight_edges,
    watch_list,
)
from solver.engines.fast.probes import probing_effort
from solver.engines.fast.request import Hazards, Movement, Safety, Start, Targets
from solver.engines.fast.symmetric import clamped, inverse


@merged
def setting_table(movement: Movement, targets: Targets, safety: Safety) -> Table:
    """Return the (1,) SETTING."""
    table = np.zeros(1, SETTING)
    setting = table[0]
    setting.steps = targets.means.shape[0]
    setting.step = movement.step
    setting.double = movement.double
    for axis in range(2):
        setting.field[axis] = movement.field_lower[axis]
        setting.field[2 + axis] = movement.field_upper[axis]
    setting.field_weight = movement.field_weight
    setting.effort = movement.effort
    setting.tracking = targets.weight
    setting.range_peak = targets.range_peak
    setting.range_shape = targets.range_shape
    setting.bearing_peak = targets.bearing_peak
    setting.bearing_shape = targets.bearing_shape
    setting.floor = targets.floor * targets.floor
    setting.distance = safety.distance
    setting.separation = safety.weight
    setting.smooth = safety.zone_smoothing
    setting.blend = safety.mate_smoothing
    return table


@merged
def robot_table(setting: Table, movement: Movement, start: Start) -> Table:
    """Return the (M,) ROBOT, positions and flags filled."""
    robots = np.zeros(movement.positions.shape[0], ROBOT)
    cold = start.previous.shape[0] == 0
    for i in range(robots.shape[0]):
        robot = robots[i]
        for axis in range(2):
            robot.position[axis] = movement.positions[i, axis]
            robot.velocity[axis] = movement.velocities[i, axis]
        robot.speed = movement.speed[i]
        robot.stale = robot.curious = True
        robot.replan = cold or start.replan[i]
        robot.effort = probing_effort(robots.shape[0], setting.steps, robot.replan)
    return robots


@merged
def target_table(setting: Table, targets: Targets) -> Table:
    """Return the (N,) TARGET."""
    table = np.zeros(targets.priors.shape[0], TARGET)
    for j in range(table.shape[0]):
        target = table[j]
        given = targets.priors
        target.prior[0], target.prior[1], target.prior[2] = clamped(
            given[j, 0, 0],
            0.5 * (given[j, 0, 1] + given[j, 1, 0]),
            given[j, 1, 1],
            targets.prior_least,
            targets.prior_greatest,
        )
        prior = target.prior
        target.known[0], target.known[1], target.known[2] = inverse(prior[0], prior[1], prior[2])
        for k in range(setting.steps):
            target.means[k, 0] = targets.means[k, j, 0]
            target.means[k, 1] = targets.means[k, j, 1]
            target.growth[k, 0] = targets.growth[k, j, 0, 0]
            target.growth[k, 1] = targets.growth[k, j, 0, 1]
            target.growth[k, 2] = targets.growth[k, j, 1, 1]
    return table


@maker
def zone_table(hazards: Hazards) -> Table:
    """Return the (K,) ZONE."""
    table = np.empty(hazards.margins.shape[0], ZONE)
    for s in range(table.shape[0]):
        zone = table[s]
        zone.centre[0], zone.centre[1] = hazards.centres[s, 0], hazards.centres[s, 1]
        zone.covariance[0] = hazards.covariances[s, 0, 0]
        zone.covariance[1] = hazards.covariances[s, 0, 1]
        zone.covariance[2] = hazards.covariances[s, 1, 1]
        zone.margin = hazards.margins[s]
        zone.quantile = hazards.quantiles[s]
        zone.weight = hazards.weight * hazards.severities[s]
    return table


@kernel
def fits_jointly(robots: int, steps: int) -> int:
    """Return 1 where the team is to be improved as a whole too, else 0."""
    return 1 if robots > 1 and 2 * robots * steps <= MAX_JOINT else 0


@merged
def most_rows(robots: Table) -> int:
    """Return the length of the longest row `rows`."""
    most = 0
    for i in range(robots.shape[0]):
        most = max(most, robots[i].rows[1] - robots[i].rows[0])
    return most


@merged
def assemble(
    movement: Movement,
    targets: Targets,
    sensing: Hazards,
    communication: Hazards,
    safety: Safety,
    start: Start,
) -> Team:
    """Return the team with all lists made; plans are not set yet."""
    settings = setting_table(movement, targets, safety)
    setting = settings[0]
    robots = robot_table(setting, movement, start)
    fill_box(setting, robots, movement)
    fill_reach(setting, robots)
    table = target_table(setting, targets)
    edges = sight_edges(setting, robots, table, targets.seen)
    watch = watch_list(table, edges)
    keep_zones = zone_table(sensing)
    keeps = keep_list(setting, robots, keep_zones, sensing.known)
    jam_zones = zone_table(communication)
    jams = jam_list(setting, robots, jam_zones, communication.known)
    mates = mate_list(setting, robots)
    rows = row_list(robots, mates)
    near = near_list(setting, robots, movement.order)
    discs = disc_list(setting, robots, safety.obstacles)
    return Team(
        setting=settings,
        robots=robots,
        targets=table,
        edges=edges,
        watch=watch,
        keep_zones=keep_zones,
        keeps=keeps,
        jam_zones=jam_zones,
        jams=jams,
        mates=mates,
        rows=rows,
        near=near,
        discs=discs,
        obstacles=safety.obstacles,
        work=np.empty(1 + fits_jointly(robots.shape[0], setting.steps), WORK),
        lengths=np.empty(robots.shape[0]),
        binding=np.empty(most_rows(robots) * setting.steps, ROW),
    )
