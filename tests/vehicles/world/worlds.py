"""Small worlds for tests."""

from solver.zones import Matrix2, Point, Zone, ZoneKind
from vehicles.world.setup import WorldRobot, WorldSetup, WorldTarget, WorldZone

UNIT: Matrix2 = ((1.0, 0.0), (0.0, 1.0))


def robot(robot_id: int, x: float, y: float = 0.0, reach: float = 1.0) -> WorldRobot:
    return WorldRobot(
        id=robot_id,
        position=(x, y),
        altitude_m=1.0 + 0.5 * robot_id,
        control_lower=(-reach, -reach),
        control_upper=(reach, reach),
    )


def zone(
    name: str,
    kind: ZoneKind,
    mean: Point = (0.0, 0.0),
    covariance: Matrix2 = UNIT,
    margin: float = 0.1,
) -> WorldZone:
    return WorldZone(Zone(name, kind, mean, covariance, margin, risk=0.1))


def world_setup(
    robots: tuple[WorldRobot, ...],
    targets: tuple[WorldTarget, ...] = (),
    zones: tuple[WorldZone, ...] = (),
    attack_period_s: float = 0.5,
    recover_density: float = 0.02,
) -> WorldSetup:
    return WorldSetup(robots, targets, zones, attack_period_s, recover_density)
