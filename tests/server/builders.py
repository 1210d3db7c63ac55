"""Small missions and solutions for tests of the core and of what drives it."""

import numpy as np

from server.mission.setup import (
    Compat,
    GateMode,
    LoopSetup,
    MeritSetup,
    MissionSetup,
    PlannerSetup,
    RobotSetup,
    TargetSetup,
    ZoneDefaults,
)
from solver.arrays import frozen
from solver.beliefs import FilterSettings
from solver.directives import Pairing, Weights
from solver.observations import Detections, RobotState, Sighting, TargetPrior
from solver.problem import Dynamics, Problem, Rung, SensorModel, Solution
from solver.zones import Point, Zone, ZoneKind

WEIGHTS = Weights(10.0, 0.05, 50.0, 50.0)


def mission_setup(
    *, robots: int = 2, targets: int = 2, tick_s: float = 0.1, steps: int = 50
) -> MissionSetup:
    """Return a team 21, 22, ... in a row, target 121 + j straight ahead of robot j."""
    return MissionSetup(
        name="test",
        team="test",
        compat=Compat.NONE,
        seed=0,
        tick_s=tick_s,
        steps=steps,
        dynamics=Dynamics.SINGLE_INTEGRATOR,
        robots=tuple(
            RobotSetup(
                id=21 + i,
                position=(-2.0, 2.0 * i),
                altitude_m=1.0 + i,
                control_lower=(-1.0, -1.0),
                control_upper=(1.0, 1.0),
                speed_limit_m_s=1.0,
                capacity=2,
            )
            for i in range(robots)
        ),
        targets=tuple(
            TargetSetup(
                id=121 + j,
                prior=TargetPrior(121 + j, (2.0, 2.0 * j), ((0.2, 0.0), (0.0, 0.2))),
            )
            for j in range(targets)
        ),
        field_lower=(-10.0, -10.0),
        field_upper=(10.0, 10.0),
        assignment=frozenset(Pairing(21 + j % robots, 121 + j) for j in range(targets)),
        weights=WEIGHTS,
        weight_lower=Weights(*(w / 10.0 for w in WEIGHTS)),
        weight_upper=Weights(*(w * 10.0 for w in WEIGHTS)),
        severity_bounds=(1.0, 5.0),
        planner=PlannerSetup(
            horizon=1, plan_step_s=tick_s, min_dist_m=0.4, separation_weight=1000.0, engine=None
        ),
        sensor=SensorModel(),
        filter=FilterSettings(),
        loops=LoopSetup(),
        merit=MeritSetup(),
        gate=GateMode.OFF,
        sensing_defaults=ZoneDefaults(0.1, 0.1, 0.1),
        communication_defaults=ZoneDefaults(0.2, 0.1, 0.1),
    )


def sensing_zone(zone_id: str = "s1", mean: Point = (0.0, 0.0)) -> Zone:
    """Return a round sensing zone of variance 0.4 m^2."""
    return Zone(zone_id, ZoneKind.SENSING, mean, ((0.4, 0.0), (0.0, 0.4)), margin=0.1, risk=0.1)


def robot_state(robot_id: int, position: Point, *, sensing_failed: bool = False) -> RobotState:
    """Return a report of a robot at rest."""
    return RobotState(robot_id, position, (0.0, 0.0), 1.0, sensing_failed)


def sighting_of(robot_id: int, position: Point, target_id: int, target: Point) -> Detections:
    """Return a noise-free detection."""
    dx, dy = target[0] - position[0], target[1] - position[1]
    sighting = Sighting(target_id, float(np.hypot(dx, dy)), float(np.arctan2(dy, dx)))
    return Detections(robot_id, position, (sighting,))


def straight_solution(problem: Problem, velocity: Point = (0.5, 0.0)) -> Solution:
    """Return the solution in which every planned robot flies one velocity."""
    count, horizon = len(problem.robot_ids), problem.horizon
    controls = np.tile(velocity, (count, horizon, 1)).reshape(count, horizon, 2)
    steps = problem.step_s * np.arange(1, horizon + 1)[None, :, None]
    return Solution(
        robot_ids=problem.robot_ids,
        controls=frozen(controls),
        positions=frozen(problem.positions[:, None, :] + steps * controls),
        velocities=frozen(controls),
        objective=1.0,
        rung=Rung.CONVERGED,
        iterations=1,
        solve_s=0.001,
        engine="straight",
    )
