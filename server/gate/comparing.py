"""What the gate is asked, read off the mission core. Reads only."""

from dataclasses import replace

import numpy as np

from server.exact import assignment_settings
from server.gate.rollout import WEIGHTS_HORIZON_S, Comparison, Course, Scene, travel_s
from server.mission.core import MissionCore
from solver.arrays import BoolArray, FloatArray, frozen, frozen_bool
from solver.directives import Directives
from solver.estimation import position_covariances
from solver.observations import Link
from solver.snapshot import Snapshot


def comparison_of(
    core: MissionCore, after: Directives, replan: tuple[int, ...], drift: FloatArray
) -> Comparison:
    """Return the directives in force beside others, from where the team is now.

    Args:
        core: The mission, between two ticks or while one is solved.
        after: The other directives.
        replan: Robots that would start afresh.
        drift: (N, 2) smoothed velocities of all targets.
    """
    before, snapshot = core.directives, core.snapshot
    problem, other = core.problem_under(before), core.problem_under(after)
    if replan:
        afresh = frozen_bool([robot_id in replan for robot_id in other.robot_ids])
        other = replace(other, replan=afresh)
    robots, beliefs = snapshot.robots, core.beliefs
    columns = np.flatnonzero(beliefs.known)
    targets = tuple(beliefs.ids[j] for j in columns)
    at = {robot_id: row for row, robot_id in enumerate(robots.ids)}
    rows = [at[robot_id] for robot_id in problem.robot_ids]
    jammed = tuple(
        robot_id
        for robot_id, link in zip(robots.ids, robots.links, strict=True)
        if link is Link.JAMMED and robot_id not in problem.robot_ids
    )
    scene = Scene(
        setup=core.setup,
        positions=frozen(beliefs.means[columns, :2]),
        drift=frozen(drift[columns]),
        covariances=frozen(position_covariances(beliefs)[columns]),
        blind=frozen_bool(robots.sensing_failed[rows]),
        absent=frozen(robots.positions[[at[robot_id] for robot_id in jammed]].reshape(-1, 2)),
        zones=snapshot.zones,
        known=frozen_bool(snapshot.known[rows]),
        tick_s=core.elapsed_s,
        likely=_likely(snapshot),
    )
    new = {(p.robot_id, p.target_id) for p in after.assignment - before.assignment}
    horizon_s = WEIGHTS_HORIZON_S
    if after.assignment != before.assignment:
        horizon_s = travel_s(snapshot, new, assignment_settings(core.setup).speed_m_s)
    return Comparison(
        scene=scene,
        in_force=Course(
            problem,
            _matrix(before, problem.robot_ids, targets),
            _matrix(before, jammed, targets),
        ),
        proposed=Course(
            other, _matrix(after, problem.robot_ids, targets), _matrix(after, jammed, targets)
        ),
        horizon_s=horizon_s,
    )


def _likely(snapshot: Snapshot) -> FloatArray:
    """Return what the density of each zone counts for, (Z,)."""
    inferred = {one.zone_id: one.confidence * one.strength for one in snapshot.inferred}
    return frozen([inferred.get(zone.id, 1.0) for zone in snapshot.zones])


def _matrix(directives: Directives, robots: tuple[int, ...], targets: tuple[int, ...]) -> BoolArray:
    """Return A over the robots and targets given."""
    rows = {robot_id: i for i, robot_id in enumerate(robots)}
    columns = {target_id: j for j, target_id in enumerate(targets)}
    answer = np.zeros((len(robots), len(targets)), dtype=bool)
    for robot_id, target_id in directives.assignment:
        if robot_id in rows and target_id in columns:
            answer[rows[robot_id], columns[target_id]] = True
    return frozen_bool(answer)
