"""The whole solve as one function of plain arrays: what is compiled ahead and cached."""

import numpy as np

from solver.arrays import BoolArray, FloatArray, IntArray
from solver.engines.fast.box import fill_box, fill_reach
from solver.engines.fast.jit import kernel
from solver.engines.fast.layout import (
    Mates,
    Motion,
    Pairs,
    Plans,
    Scratch,
    Sight,
    Smoothing,
    Team,
    Zones,
)
from solver.engines.fast.lists import (
    mate_lists,
    near_obstacles,
    near_pairs,
    sight_edges,
    transposed,
    widest_spread,
    zone_edges,
)
from solver.engines.fast.request import Hazards, Movement, Safety, Start, Targets
from solver.engines.fast.robot import settle, team_cost
from solver.engines.fast.rollout import roll
from solver.engines.fast.sweeps import Progress, improve
from solver.engines.fast.symmetric import clamped
from solver.engines.fast.tracking import CHAIN

Answer = tuple[FloatArray, FloatArray, FloatArray, float, int, bool]


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
        Controls, positions and velocities, each (M, H, 2); the objective; Newton steps of the
        robot that took most; whether it converged.
    """
    steps = targets.means.shape[0]
    motion = _motion(movement, steps)
    team = _team(motion, targets, sensing, communication, safety)
    _begin(team, start.previous)
    robots = motion.positions.shape[0]
    first = start.previous.shape[0] == 0
    wanted = start.replan.copy()
    if first or steps == 1:
        wanted[:] = True
    replan = start.replan.copy()
    if first:
        replan[:] = True
    taken = np.zeros(robots, np.int64)
    progress = Progress(np.ones(robots, np.bool_), wanted, replan, taken)
    converged = improve(team, progress, team_cost(team), start.iterations, start.deadline)
    velocities = np.empty((robots, steps, 2))
    for i in range(robots):
        u = team.plans.controls[i].reshape(2 * steps)
        roll(motion, i, u, team.plans.paths[i], velocities[i])
    most = taken.max() if robots > 0 else 0
    return team.plans.controls, team.plans.paths, velocities, team_cost(team), most, converged


@kernel
def _motion(movement: Movement, steps: int) -> Motion:
    robots = movement.positions.shape[0]
    lower = np.empty((robots, 2 * steps))
    upper = np.empty((robots, 2 * steps))
    field = np.concatenate((movement.field_lower, movement.field_upper))
    fill_box(
        movement.step,
        movement.double,
        movement.positions,
        movement.velocities,
        movement.control_lower,
        movement.control_upper,
        movement.speed,
        field,
        lower,
        upper,
    )
    reach = np.empty(robots)
    fill_reach(movement.step, movement.double, movement.velocities, lower, upper, reach)
    return Motion(
        step=movement.step,
        double=movement.double,
        positions=movement.positions,
        velocities=movement.velocities,
        lower=lower,
        upper=upper,
        reach=reach,
        speed=movement.speed,
        field=field,
        field_weight=movement.field_weight,
        effort=movement.effort,
    )


@kernel
def _sight(motion: Motion, targets: Targets) -> Sight:
    steps, count = targets.means.shape[0], targets.priors.shape[0]
    priors = np.empty((count, 3))
    for j in range(count):
        priors[j, 0], priors[j, 1], priors[j, 2] = clamped(
            targets.priors[j, 0, 0],
            0.5 * (targets.priors[j, 0, 1] + targets.priors[j, 1, 0]),
            targets.priors[j, 1, 1],
            targets.prior_least,
            targets.prior_greatest,
        )
    start, target, robot = sight_edges(
        motion, targets.seen, targets.means, priors, targets.growth, targets.sensor
    )
    watch_start, watch = transposed(target, count)
    return Sight(
        start=start,
        target=target,
        watch_start=watch_start,
        watch=watch,
        robot=robot,
        information=np.zeros((target.shape[0], steps, 3)),
        means=targets.means,
        priors=priors,
        growth=targets.growth,
        sensor=targets.sensor,
        weight=targets.weight,
    )


@kernel
def _zones(motion: Motion, hazards: Hazards, spread: FloatArray, smooth: Smoothing) -> Zones:
    weights = hazards.weight * hazards.severities
    start, zone = zone_edges(
        motion,
        hazards.known,
        hazards.centres,
        hazards.covariances,
        hazards.quantiles,
        weights,
        hazards.margins,
        spread,
        smooth.zone,
    )
    return Zones(
        start=start,
        zone=zone,
        centres=hazards.centres,
        covariances=hazards.covariances,
        margins=hazards.margins,
        quantiles=hazards.quantiles,
        weights=weights,
        clearance=np.zeros((zone.shape[0], motion.lower.shape[1] // 2)),
    )


@kernel
def _pairs(motion: Motion, safety: Safety) -> Pairs:
    smoothing = safety.zone_smoothing
    start, mate = near_pairs(motion, safety.distance, smoothing)
    obstacle_start, obstacle = near_obstacles(
        motion, safety.obstacles, safety.distance, smoothing
    )
    return Pairs(
        start=start,
        mate=mate,
        obstacle_start=obstacle_start,
        obstacle=obstacle,
        obstacles=safety.obstacles,
        distance=safety.distance,
        weight=safety.weight,
    )


@kernel
def _widest_row(start: IntArray) -> int:
    widest = 0
    for row in range(start.shape[0] - 1):
        widest = max(widest, start[row + 1] - start[row])
    return widest


@kernel
def _scratch(robots: int, steps: int, targets: int, rows: int) -> Scratch:
    size = 2 * steps
    return Scratch(
        u=np.empty(size),
        trial=np.empty(size),
        fresh=np.empty(size),
        direction=np.empty(size),
        gradient=np.empty(size),
        path=np.empty((steps, 2)),
        speeds=np.empty((steps, 2)),
        slope=np.empty((steps, 2)),
        speed_slope=np.empty((steps, 2)),
        speed_bend=np.empty((steps, 2)),
        bend=np.empty((size, size)),
        factor=np.empty((size, size)),
        basis=np.empty((size, size)),
        free=np.empty(size, np.int64),
        vector=np.empty(size),
        work=np.empty(size),
        chain=np.empty((steps, CHAIN)),
        others=np.empty((targets, steps, 3)),
        mate_terms=np.empty((robots, 2)),
        row_robot=np.empty(rows * steps, np.int64),
        row_step=np.empty(rows * steps, np.int64),
        row_terms=np.empty((rows * steps, 2)),
        timespec=np.zeros(2, np.int64),
    )


@kernel
def _team(
    motion: Motion, targets: Targets, sensing: Hazards, communication: Hazards, safety: Safety
) -> Team:
    robots = motion.positions.shape[0]
    smooth = Smoothing(safety.zone_smoothing, safety.mate_smoothing)
    sight = _sight(motion, targets)
    keep = _zones(motion, sensing, np.ones(robots), smooth)
    spread = widest_spread(motion, communication.known, smooth)
    jam = _zones(motion, communication, spread, smooth)
    mates = mate_lists(motion, jam.start, smooth)
    steps = targets.means.shape[0]
    return Team(
        motion=motion,
        plans=Plans(np.empty((robots, steps, 2)), np.empty((robots, steps, 2))),
        sight=sight,
        keep=keep,
        jam=jam,
        mates=mates,
        pairs=_pairs(motion, safety),
        smooth=smooth,
        scratch=_scratch(robots, steps, _widest_row(sight.start), _widest_row(mates.row_start)),
    )


@kernel
def _begin(team: Team, previous: FloatArray) -> None:
    """Start from the last plan moved into the box, or from rest."""
    u = team.scratch.u
    for i in range(team.motion.lower.shape[0]):
        for at in range(u.shape[0]):
            value = 0.0
            if previous.shape[0] > 0:
                value = previous[i, at // 2, at % 2]
            u[at] = min(max(value, team.motion.lower[i, at]), team.motion.upper[i, at])
        settle(team, i, u)
