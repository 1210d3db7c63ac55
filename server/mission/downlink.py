"""What the planner tells each robot, so that it can fly on when it is cut off."""

import numpy as np

from server.mission.core import MissionCore
from server.mission.setup import MissionSetup
from solver.observations import Link, OnboardTrack
from vehicles.knowledge import FlightRules, Knowledge, Mate


def flight_rules(setup: MissionSetup, robot_id: int) -> FlightRules:
    """Return what holds for one robot through the whole mission.

    Raises KeyError for an unknown robot.
    """
    robots = {robot.id: robot for robot in setup.robots}
    robot = robots[robot_id]
    return FlightRules(
        step_s=setup.planner.plan_step_s,
        horizon=setup.planner.horizon,
        dynamics=setup.dynamics,
        control_lower=robot.control_lower,
        control_upper=robot.control_upper,
        speed_limit_m_s=robot.speed_limit_m_s,
        field_lower=setup.field_lower,
        field_upper=setup.field_upper,
        min_dist_m=setup.planner.min_dist_m,
        separation_weight=setup.planner.separation_weight,
        sensor=setup.sensor,
        filter=setup.filter,
    )


def knowledge_for(robot_id: int, core: MissionCore) -> Knowledge:
    """Return what a robot should know as of the core's newest snapshot.

    Raises KeyError for an unknown robot.
    """
    snapshot, beliefs = core.snapshot, core.beliefs
    targets = snapshot.directives.targets_of(robot_id)
    rows = {target_id: row for row, target_id in enumerate(beliefs.ids)}
    row = snapshot.robots.ids.index(robot_id)
    tracks = tuple(
        OnboardTrack(
            target_id=target_id,
            mean=tuple(beliefs.means[rows[target_id]].tolist()),
            covariance=tuple(tuple(r) for r in beliefs.covariances[rows[target_id]].tolist()),
        )
        for target_id in targets
        if target_id in rows and beliefs.known[rows[target_id]]
    )
    mates = tuple(
        Mate(mate_id, (float(position[0]), float(position[1])))
        for mate_id, position, link in zip(
            snapshot.robots.ids, snapshot.robots.positions, snapshot.robots.links, strict=True
        )
        if mate_id != robot_id and link is not Link.LOST
    )
    return Knowledge(
        robot_id=robot_id,
        mission=snapshot.mission,
        time_s=snapshot.time_s,
        rules=flight_rules(core.setup, robot_id),
        weights=snapshot.directives.weights,
        targets=targets,
        tracks=tracks,
        zones=tuple(snapshot.zones[z] for z in np.flatnonzero(snapshot.known[row])),
        severities=snapshot.directives.severities,
        mates=mates,
        prices=core.prices,
    )
