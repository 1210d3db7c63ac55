"""The simulated world: its state, its dice, its counters.

One lockstep step is attack, sense, (plan), move; live, the same at every tick. Dice are keyed
by (purpose, robot, zone or target, step), and `move` ends a step: asked twice within one step,
the world gives the same answer.
"""

from collections.abc import Container, Iterable, Mapping
from math import hypot

import numpy as np

from solver.arrays import BoolArray, FloatArray
from solver.observations import Detections, RobotState
from solver.problem import Dynamics
from solver.streams import Streams
from solver.zones import Point, Zone, ZoneKind
from vehicles.world.attacks import densities, hit_probabilities, jammed
from vehicles.world.motion import Kinematics, Linear, RandomWalk, advance, at_time
from vehicles.world.sensing import measure
from vehicles.world.setup import Discovery, WorldRobot, WorldSetup, WorldTarget, WorldZone
from vehicles.world.spacing import closest_m
from vehicles.world.state import (
    Cause,
    Failures,
    Hit,
    Recovery,
    TrueRobot,
    TrueTarget,
    Truth,
    WorldEvent,
)

KINDS = (ZoneKind.SENSING, ZoneKind.COMMUNICATION)


class World:
    """A world that advances when it is told to. It plans nothing and knows no beliefs.

    Args:
        setup: The world at time 0.
        streams: The dice; nobody else's.
    """

    def __init__(self, setup: WorldSetup, streams: Streams) -> None:
        self.setup = setup
        self.time_s = 0.0
        self.step = 0
        self._streams = streams
        self._rows = {robot.id: row for row, robot in enumerate(setup.robots)}
        self._control_lower = _points(robot.control_lower for robot in setup.robots)
        self._control_upper = _points(robot.control_upper for robot in setup.robots)
        self._double = _is_double(setup.robots)
        self._positions = _points(robot.position for robot in setup.robots)
        self._velocities = _points(robot.velocity for robot in setup.robots)
        self._altitudes = np.array([robot.altitude_m for robot in setup.robots], dtype=np.float64)
        self._climbs = np.array([robot.climb_m_s for robot in setup.robots], dtype=np.float64)
        self._targets = {
            target.id: Kinematics(target.position, target.velocity) for target in setup.targets
        }
        self._zones = tuple(zone.zone for zone in setup.zones)
        self._failed = {kind: np.zeros(len(setup.robots), dtype=np.bool_) for kind in KINDS}
        self._hits = dict.fromkeys(KINDS, 0)
        self._paths = np.zeros(len(setup.robots))
        self._placed = np.zeros(len(setup.robots), dtype=np.bool_)
        self._separation = closest_m(self._positions)

    # ------------------------------------------------------------------ one step

    def attack(self, dt_s: float, absent: Container[int] = ()) -> tuple[WorldEvent, ...]:
        """Let every zone roll its dice at every robot; then let robots recover.

        Args:
            dt_s: Length of the step the dice stand for.
            absent: Ids of robots to which nothing happens, because nobody flies them now.

        Returns:
            Hits and recoveries, by robot in team order, sensing first, by zone as set up.
        """
        chances = hit_probabilities(
            densities(self._zones, self._positions), dt_s, self.setup.attack_period_s
        )
        spread = jammed(self._zones, self._positions, self.setup.jamming)
        events: list[WorldEvent] = []
        for row, robot in enumerate(self.setup.robots):
            if robot.id in absent:
                continue
            for kind in KINDS:
                hits = [
                    self._hit(robot.id, zone, cause)
                    for column, zone in enumerate(self._zones)
                    if zone.kind is kind
                    and (cause := self._cause(row, column, chances, spread)) is not None
                ]
                events.extend(hits)
                events.extend(self._settle(row, kind, hits))
        return tuple(events)

    def sense(self, robot_id: int, target_ids: Iterable[int]) -> Detections | None:
        """Return what a robot measures of these targets, None in sensing failure.

        Targets that are not of this world, or beyond the detection range, are left out.

        Raises:
            KeyError: When there is no such robot.
        """
        row = self._rows[robot_id]
        if self._failed[ZoneKind.SENSING][row]:
            return None
        position = _point(self._positions[row])
        limit = self.setup.detection_range_m
        sightings = []
        for target_id in target_ids:
            target = self._targets.get(target_id)
            if target is None:
                continue
            x, y = target.position
            if limit is not None and hypot(x - position[0], y - position[1]) > limit:
                continue
            draws = self._streams.normals("measurement", robot_id, target_id, self.step, 2)
            noise = (float(draws[0]), float(draws[1]))
            sightings.append(
                measure(
                    self.setup.sensor,
                    self.setup.noise,
                    position,
                    (target_id, target.position),
                    noise,
                )
            )
        return Detections(robot_id, position, tuple(sightings))

    def place(self, state: RobotState) -> None:
        """Put a robot that is flown elsewhere where it says it is; `move` leaves it there.

        Args:
            state: Where it is. Whether it can sense is the world's business, not its own.

        Raises:
            KeyError: When there is no such robot.
        """
        row = self._rows[state.robot_id]
        position = np.array(state.position)
        if self._placed[row]:
            self._paths[row] += np.linalg.norm(position - self._positions[row])
        self._placed[row] = True
        self._positions[row] = position
        self._velocities[row] = state.velocity
        self._altitudes[row] = state.altitude_m

    def move(
        self,
        dt_s: float,
        velocities: Mapping[int, Point],
        altitudes: Mapping[int, float] | None = None,
    ) -> None:
        """Fly every robot and move every target and zone for one step; the step ends.

        A single integrator flies its velocity, clipped to its box. A double integrator
        accelerates uniformly over the step, within its box, towards the velocity (which it has
        at the end of the step). A robot that is not named stops, one that was placed stays as
        it is.

        Args:
            dt_s: Length of the step, above 0.
            velocities: Commanded velocity per robot id, m/s.
            altitudes: Altitude to climb or sink to, per robot id, metres; others keep theirs.

        Raises:
            KeyError: When a command is for a robot that does not exist.
            ValueError: When a command is not finite or dt_s is not above 0.
        """
        if not dt_s > 0.0:
            raise ValueError(f"dt_s: {dt_s} is not above 0")
        commands = np.zeros_like(self._velocities)
        for robot_id, velocity in velocities.items():
            commands[self._rows[robot_id]] = velocity
        heights = self._altitudes.copy()
        for robot_id, altitude in (altitudes or {}).items():
            heights[self._rows[robot_id]] = altitude
        if not (np.isfinite(commands).all() and np.isfinite(heights).all()):
            raise ValueError(f"commands: not finite: {dict(velocities)}, {altitudes}")
        reach = dt_s * self._climbs
        self._altitudes = self._altitudes + np.clip(heights - self._altitudes, -reach, reach)
        before, speeds, placed = self._positions, self._velocities, self._placed[:, None]
        moved, changed = self._fly(dt_s, commands)
        self._positions = np.where(placed, before, moved)
        self._velocities = np.where(placed, speeds, changed)
        self._paths += np.linalg.norm(self._positions - before, axis=1)
        self.step += 1
        self.time_s += dt_s
        for target in self.setup.targets:
            self._targets[target.id] = self._advanced(target, dt_s)
        self._zones = tuple(_zone_at(zone, self.time_s) for zone in self.setup.zones)
        self._separation = min(self._separation, closest_m(self._positions))

    # ------------------------------------------------------------------ what is true now

    def robot_state(self, robot_id: int) -> RobotState:
        """Return where a robot is, as it reports it (exact self-localisation).

        Raises:
            KeyError: When there is no such robot.
        """
        row = self._rows[robot_id]
        return RobotState(
            robot_id=robot_id,
            position=_point(self._positions[row]),
            velocity=_point(self._velocities[row]),
            altitude_m=float(self._altitudes[row]),
            sensing_failed=bool(self._failed[ZoneKind.SENSING][row]),
        )

    def failures(self, robot_id: int) -> Failures:
        """Return what a robot cannot do now.

        Raises:
            KeyError: When there is no such robot.
        """
        row = self._rows[robot_id]
        return Failures(
            sensing=bool(self._failed[ZoneKind.SENSING][row]),
            communication=bool(self._failed[ZoneKind.COMMUNICATION][row]),
        )

    def truth(self) -> Truth:
        """Return everything as it really is now."""
        return Truth(
            time_s=self.time_s,
            step=self.step,
            robots=tuple(
                TrueRobot(
                    robot.id,
                    _point(self._positions[row]),
                    _point(self._velocities[row]),
                    float(self._altitudes[row]),
                    self.failures(robot.id),
                )
                for row, robot in enumerate(self.setup.robots)
            ),
            targets=tuple(
                TrueTarget(target_id, now.position, now.velocity)
                for target_id, now in self._targets.items()
            ),
            zones=self._zones,
        )

    def take_over(self, truth: Truth) -> None:
        """Go on from what was true in a world of the same setup; counters start from 0.

        Raises:
            KeyError: When the truth tells of a robot or target that is not of this world.
        """
        self.time_s, self.step = truth.time_s, truth.step
        for robot in truth.robots:
            row = self._rows[robot.id]
            self._positions[row] = robot.position
            self._velocities[row] = robot.velocity
            self._altitudes[row] = robot.altitude_m
            for kind in KINDS:
                self._failed[kind][row] = robot.failures.of(kind)
        for target in truth.targets:
            if target.id not in self._targets:
                raise KeyError(target.id)
            self._targets[target.id] = Kinematics(target.position, target.velocity)
        self._zones = tuple(_zone_at(zone, self.time_s) for zone in self.setup.zones)
        self._separation = closest_m(self._positions)

    # ------------------------------------------------------------------ counters

    def hits(self, kind: ZoneKind) -> int:
        """Return how often zones of a kind have hit; a robot hit again counts again."""
        return self._hits[kind]

    def path_length_m(self, robot_id: int) -> float:
        """Return the way a robot has flown, every move counted.

        Raises:
            KeyError: When there is no such robot.
        """
        return float(self._paths[self._rows[robot_id]])

    @property
    def min_separation_m(self) -> float | None:
        """Smallest distance in the plane between two robots at the end of any step so far.

        The start counts; None with fewer than two robots.
        """
        return None if np.isinf(self._separation) else self._separation

    # ------------------------------------------------------------------ inside

    def _cause(self, row: int, column: int, chances: FloatArray, spread: BoolArray) -> Cause | None:
        zone = self._zones[column]
        chance = float(chances[row, column])
        robot_id = self.setup.robots[row].id
        # A density that has underflowed to 0 needs no draw: no number is below 0.
        if chance > 0.0:
            draw = self._streams.uniform(f"attack.{zone.kind.value}", robot_id, column, self.step)
            if draw < chance:
                return Cause.DICE
        return Cause.SPREAD if spread[row, column] else None

    def _hit(self, robot_id: int, zone: Zone, cause: Cause) -> Hit:
        revealed = zone if self.setup.discovery is Discovery.ORACLE else None
        return Hit(robot_id, zone.kind, revealed, cause, self.time_s)

    def _settle(self, row: int, kind: ZoneKind, hits: list[Hit]) -> tuple[Recovery, ...]:
        """Count the hits; fail the robot, or let it recover when it is outside of every zone."""
        failed = self._failed[kind]
        self._hits[kind] += len(hits)
        if hits:
            failed[row] = True
        elif failed[row] and not self._inside(row, kind):
            failed[row] = False
            return (Recovery(self.setup.robots[row].id, kind, self.time_s),)
        return ()

    def _inside(self, row: int, kind: ZoneKind) -> bool:
        return any(
            float(zone.density(self._positions[row])) >= self.setup.recover_density
            for zone in self._zones
            if zone.kind is kind
        )

    def _fly(self, dt_s: float, commands: FloatArray) -> tuple[FloatArray, FloatArray]:
        lower, upper, double = self._control_lower, self._control_upper, self._double
        slow = np.clip(commands, lower, upper)
        acceleration = np.clip((commands - self._velocities) / dt_s, lower, upper)
        after = np.where(double, self._velocities + dt_s * acceleration, slow)
        mean = np.where(double, 0.5 * (self._velocities + after), slow)
        return self._positions + dt_s * mean, after

    def _advanced(self, target: WorldTarget, dt_s: float) -> Kinematics:
        motion = target.motion
        if not isinstance(motion, Linear | RandomWalk):
            return at_time(motion, target.position, self.time_s, dt_s)
        noise = (0.0, 0.0)
        if isinstance(motion, RandomWalk):
            draws = self._streams.normals("target.walk", 0, target.id, self.step, 2)
            noise = (float(draws[0]), float(draws[1]))
        return advance(motion, self._targets[target.id], target.velocity, dt_s, noise)


def _points(points: Iterable[Point]) -> FloatArray:
    return np.array(list(points), dtype=np.float64).reshape(-1, 2)


def _point(row: FloatArray) -> Point:
    return (float(row[0]), float(row[1]))


def _is_double(robots: tuple[WorldRobot, ...]) -> BoolArray:
    """Return a (M, 1) mask of the double integrators."""
    return np.array(
        [[robot.dynamics is Dynamics.DOUBLE_INTEGRATOR] for robot in robots], dtype=np.bool_
    ).reshape(-1, 1)


def _zone_at(zone: WorldZone, time_s: float) -> Zone:
    if zone.velocity == (0.0, 0.0) and zone.growth_m2_s == 0.0:
        return zone.zone
    (x, y), (u, v) = zone.zone.mean, zone.velocity
    (a, b), (c, d) = zone.zone.covariance
    grown = zone.growth_m2_s * time_s
    return Zone(
        id=zone.zone.id,
        kind=zone.zone.kind,
        mean=(x + u * time_s, y + v * time_s),
        covariance=((a + grown, b), (c, d + grown)),
        margin=zone.zone.margin,
        risk=zone.zone.risk,
        risk_single=zone.zone.risk_single,
    )
