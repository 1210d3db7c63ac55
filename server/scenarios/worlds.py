"""From a scenario to the world as it really is."""

from typing import TYPE_CHECKING

from server.mission.setup import Compat
from server.scenarios.parts import (
    CircleMotion,
    LinearMotion,
    MotionPart,
    RandomWalkMotion,
    ReplayMotion,
    RobotPart,
    TargetPart,
    WaypointMotion,
    ZonePart,
)
from solver.problem import Dynamics
from solver.zones import Point, Zone, ZoneKind
from vehicles.world.motion import Circle, Linear, Motion, RandomWalk, Replay, Waypoints
from vehicles.world.setup import (
    JammingLaw,
    NoiseLaw,
    WorldRobot,
    WorldSetup,
    WorldTarget,
    WorldZone,
)

if TYPE_CHECKING:
    from server.scenarios.schema import Scenario


def world_setup(scenario: "Scenario") -> WorldSetup:
    """Return the world at time 0; attack laws and noise follow the scenario's `compat`."""
    authors = scenario.compat is Compat.AUTHORS
    return WorldSetup(
        robots=tuple(_robot(robot, scenario.dynamics) for robot in scenario.robots),
        targets=tuple(map(_target, scenario.targets)),
        zones=tuple(_zone(zone, scenario) for zone in scenario.zones),
        attack_period_s=scenario.attacks.period_s,
        recover_density=scenario.attacks.recover_density,
        sensor=scenario.sensor_model(),
        noise=NoiseLaw.AUTHORS if authors else NoiseLaw.SOUND,
        jamming=JammingLaw.AUTHORS if authors else JammingLaw.LINEAR,
        discovery=scenario.discovery,
        detection_range_m=scenario.sensor.detection_range_m,
    )


def _robot(robot: RobotPart, dynamics: Dynamics) -> WorldRobot:
    return WorldRobot(
        id=robot.id,
        position=robot.position,
        altitude_m=robot.altitude_m,
        control_lower=robot.control_lower,
        control_upper=robot.control_upper,
        dynamics=dynamics,
    )


def _target(target: TargetPart) -> WorldTarget:
    motion, velocity = _motion(target.motion)
    return WorldTarget(target.id, target.position, velocity, motion)


def _motion(part: MotionPart) -> tuple[Motion, Point]:
    match part:
        case LinearMotion():
            return Linear(), part.velocity
        case RandomWalkMotion():
            return RandomWalk(part.deviation), part.velocity
        case WaypointMotion():
            return Waypoints(part.points, part.speed_m_s, part.ending), (0.0, 0.0)
        case CircleMotion():
            return Circle(part.centre, part.rate_rad_s), (0.0, 0.0)
        case ReplayMotion():
            return Replay(part.times_s, part.positions), (0.0, 0.0)


def _zone(part: ZonePart, scenario: "Scenario") -> WorldZone:
    by_kind = scenario.zone_defaults
    default = by_kind.sensing if part.kind is ZoneKind.SENSING else by_kind.communication
    zone = Zone(
        id=part.id,
        kind=part.kind,
        mean=part.mean,
        covariance=part.covariance,
        margin=default.margin if part.margin is None else part.margin,
        risk=default.risk if part.risk is None else part.risk,
        risk_single=default.risk_single if part.risk_single is None else part.risk_single,
    )
    return WorldZone(zone, part.velocity, part.growth_m2_s)
