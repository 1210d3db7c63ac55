"""What a simulated world is made of. Immutable; checked when made.

Frame ENU, metres, seconds. Made from a scenario; goes to the world's process as JSON
(`vehicles.sim_job`).
"""

from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from math import isfinite

from solver.problem import Dynamics, SensorModel
from solver.zones import Point, Zone
from vehicles.world.motion import Circle, Linear, Motion, RandomWalk, Replay, Waypoints


class NoiseLaw(StrEnum):
    """What the sensor model's R(d) = 1 / (peak exp(-shape d)) is of the noise."""

    SOUND = "sound"
    """Its variance."""

    AUTHORS = "authors"
    """Its standard deviation, as in the paper authors' program (1e-4 added to 1/R and d^2)."""


class JammingLaw(StrEnum):
    """How near a communication zone's centre jams for certain, by the spread of the team."""

    LINEAR = "linear"
    """delta * spread: the constraint's own rule."""

    AUTHORS = "authors"
    """delta * sqrt(spread), with their program's 1e-4 terms."""


class Discovery(StrEnum):
    """What a robot learns from a hit."""

    ORACLE = "oracle"
    """The zone, exactly as it is at that moment (the paper)."""

    INFERRED = "inferred"
    """Only that it was hit."""


@dataclass(frozen=True, slots=True)
class WorldRobot:
    """One robot and what its body can do."""

    id: int
    position: Point
    altitude_m: float
    control_lower: Point
    control_upper: Point
    """Box per axis: velocity in m/s (single integrator), acceleration in m/s^2 (double)."""

    dynamics: Dynamics = Dynamics.SINGLE_INTEGRATOR
    velocity: Point = (0.0, 0.0)
    """At the start, m/s."""

    climb_m_s: float = 0.5
    """How fast it climbs and sinks."""


@dataclass(frozen=True, slots=True)
class WorldTarget:
    """One target and how it moves."""

    id: int
    position: Point
    velocity: Point = (0.0, 0.0)
    """Set velocity of linear and random-walk motion, m/s."""

    motion: Motion = field(default_factory=Linear)


@dataclass(frozen=True, slots=True)
class WorldZone:
    """One danger zone as it really is."""

    zone: Zone
    """As it is at time 0; its risks are only passed on to whom it is revealed."""

    velocity: Point = (0.0, 0.0)
    """Of its centre, m/s."""

    growth_m2_s: float = 0.0
    """Added to both diagonal entries of its covariance per second; not negative."""


@dataclass(frozen=True, slots=True)
class WorldSetup:
    """A world at time 0.

    Raises:
        ValueError: When ids repeat, numbers are not finite or a shape makes no sense; the
            message names the item and the field.
    """

    robots: tuple[WorldRobot, ...]
    targets: tuple[WorldTarget, ...]
    zones: tuple[WorldZone, ...]
    attack_period_s: float
    """A zone's density at the robot times dt / attack_period_s is the hit probability."""

    recover_density: float
    """A robot is outside a zone where its density is below this, 1/m^2."""

    sensor: SensorModel = field(default_factory=SensorModel)
    noise: NoiseLaw = NoiseLaw.SOUND
    jamming: JammingLaw = JammingLaw.LINEAR
    discovery: Discovery = Discovery.ORACLE
    detection_range_m: float | None = None
    """Targets farther away are not seen; None sees any distance."""

    def __post_init__(self) -> None:
        _check_unique("robots", [robot.id for robot in self.robots])
        _check_unique("targets", [target.id for target in self.targets])
        _check_unique("zones", [zone.zone.id for zone in self.zones])
        _check_positive("attack_period_s", self.attack_period_s)
        _check_positive("recover_density", self.recover_density)
        if self.detection_range_m is not None:
            _check_positive("detection_range_m", self.detection_range_m)
        for name in ("range_peak", "bearing_peak"):
            _check_positive(f"sensor.{name}", getattr(self.sensor, name))
        for robot in self.robots:
            _check_robot(robot)
        for target in self.targets:
            _check_target(target)
        for zone in self.zones:
            _check_zone(zone)


def _check_unique(where: str, ids: list[int] | list[str]) -> None:
    repeated = sorted({str(one) for one in ids if ids.count(one) > 1})  # type: ignore[arg-type]
    if repeated:
        raise ValueError(f"{where}: id {', '.join(repeated)} is given more than once")


def _check_positive(where: str, value: float) -> None:
    if not (isfinite(value) and value > 0.0):
        raise ValueError(f"{where}: {value} is not a finite number above 0")


def _check_finite(where: str, *values: float) -> None:
    for value in values:
        if not isfinite(value):
            raise ValueError(f"{where}: {value} is not a finite number")


def _check_robot(robot: WorldRobot) -> None:
    where = f"robot {robot.id}"
    _check_finite(f"{where}: position", *robot.position, robot.altitude_m)
    _check_finite(f"{where}: velocity", *robot.velocity)
    _check_positive(f"{where}: climb_m_s", robot.climb_m_s)
    for lower, upper in zip(robot.control_lower, robot.control_upper, strict=True):
        _check_finite(f"{where}: control box", lower, upper)
        if lower > upper:
            raise ValueError(f"{where}: control box: {lower} lies above {upper}")


def _check_target(target: WorldTarget) -> None:
    where = f"target {target.id}"
    _check_finite(f"{where}: position", *target.position)
    _check_finite(f"{where}: velocity", *target.velocity)
    match target.motion:
        case Linear():
            pass
        case RandomWalk(deviation=deviation):
            _check_finite(f"{where}: deviation", deviation)
            if deviation < 0.0:
                raise ValueError(f"{where}: deviation: {deviation} is negative")
        case Waypoints(points=points, speed_m_s=speed):
            _check_finite(f"{where}: points", *(value for point in points for value in point))
            _check_positive(f"{where}: speed_m_s", speed)
            if not points:
                raise ValueError(f"{where}: points: at least one is needed")
        case Circle(centre=centre, rate_rad_s=rate):
            _check_finite(f"{where}: circle", *centre, rate)
        case Replay() as replay:
            _check_replay(where, replay)


def _check_replay(where: str, replay: Replay) -> None:
    times, positions = replay.times_s, replay.positions
    if len(times) != len(positions) or not times:
        raise ValueError(f"{where}: replay: {len(times)} times for {len(positions)} positions")
    _check_finite(f"{where}: replay", *times, *(value for point in positions for value in point))
    if any(after <= before for before, after in pairwise(times)):
        raise ValueError(f"{where}: replay: times do not increase")


def _check_zone(zone: WorldZone) -> None:
    where = f"zone {zone.zone.id}"
    (a, b), (c, d) = zone.zone.covariance
    _check_finite(f"{where}: mean", *zone.zone.mean)
    _check_finite(f"{where}: covariance", a, b, c, d)
    if abs(b - c) > 1e-9 * max(a, d, 1e-300) or a <= 0.0 or a * d - b * c <= 0.0:
        raise ValueError(f"{where}: covariance: not symmetric positive definite")
    _check_finite(f"{where}: margin", zone.zone.margin)
    _check_finite(f"{where}: velocity", *zone.velocity)
    _check_finite(f"{where}: growth_m2_s", zone.growth_m2_s)
    if zone.growth_m2_s < 0.0:
        raise ValueError(f"{where}: growth_m2_s: {zone.growth_m2_s} is negative")
