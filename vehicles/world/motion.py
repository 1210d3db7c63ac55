"""How targets move. Frame ENU, metres, seconds.

Motions with a given path (waypoints, circle, replay) are functions of time, exact at any step
size; linear and random-walk motion are advanced step by step, as in the paper's simulation.
"""

from bisect import bisect_left
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from math import cos, hypot, sin, sqrt
from typing import Literal, NamedTuple

from solver.zones import Point


class Kinematics(NamedTuple):
    """Where a target is and how fast it goes."""

    position: Point
    velocity: Point


@dataclass(frozen=True, slots=True)
class Linear:
    """Constant velocity for ever; the field does not hold it back."""

    kind: Literal["linear"] = "linear"


@dataclass(frozen=True, slots=True)
class RandomWalk:
    """The given velocity plus Brownian motion."""

    deviation: float
    """Standard deviation of each axis after one second, m/sqrt(s)."""

    kind: Literal["random_walk"] = "random_walk"


class Ending(StrEnum):
    """What a target does at the end of its path."""

    STOP = "stop"
    LOOP = "loop"
    """Back to the first point, in a straight line, and round again."""


@dataclass(frozen=True, slots=True)
class Waypoints:
    """From the start through these points at constant speed."""

    points: tuple[Point, ...]
    speed_m_s: float
    ending: Ending = Ending.STOP
    kind: Literal["waypoints"] = "waypoints"


@dataclass(frozen=True, slots=True)
class Circle:
    """Around a centre, from the start position, at constant rate."""

    centre: Point
    rate_rad_s: float
    """Positive is counter-clockwise."""

    kind: Literal["circle"] = "circle"


@dataclass(frozen=True, slots=True)
class Replay:
    """A recorded track, linear between its samples, still before the first and after the last."""

    times_s: tuple[float, ...]
    positions: tuple[Point, ...]
    kind: Literal["replay"] = "replay"


Motion = Linear | RandomWalk | Waypoints | Circle | Replay


def at_time(
    motion: Waypoints | Circle | Replay, start: Point, time_s: float, dt_s: float
) -> Kinematics:
    """Return where a target with a given path is.

    Args:
        motion: The path.
        start: Position at time 0, metres. A replay ignores it.
        time_s: Time since the start of the world.
        dt_s: Length of the step that ends now. The velocity is the mean over it, so that
            position and velocity agree; 0 asks for none and gives a zero velocity.

    Returns:
        Position and mean velocity.
    """
    position = _path_position(motion, start, time_s)
    if dt_s <= 0.0:
        return Kinematics(position, (0.0, 0.0))
    before = _path_position(motion, start, time_s - dt_s)
    velocity = ((position[0] - before[0]) / dt_s, (position[1] - before[1]) / dt_s)
    return Kinematics(position, velocity)


def advance(
    motion: Linear | RandomWalk, now: Kinematics, drift: Point, dt_s: float, noise: Point
) -> Kinematics:
    """Return where a target is one step later.

    Args:
        motion: Linear or random walk.
        now: Position and velocity before the step.
        drift: The target's set velocity, m/s.
        dt_s: Length of the step.
        noise: Two standard normal numbers; unused by linear motion.

    Returns:
        Position after the step and the mean velocity over it.
    """
    if isinstance(motion, Linear):
        velocity = drift
    else:
        scale = motion.deviation / sqrt(dt_s)
        velocity = (drift[0] + scale * noise[0], drift[1] + scale * noise[1])
    x, y = now.position
    return Kinematics((x + dt_s * velocity[0], y + dt_s * velocity[1]), velocity)


def _path_position(motion: Waypoints | Circle | Replay, start: Point, time_s: float) -> Point:
    time_s = max(time_s, 0.0)
    match motion:
        case Circle(centre=centre, rate_rad_s=rate):
            east, north = start[0] - centre[0], start[1] - centre[1]
            turn = rate * time_s
            return (
                centre[0] + east * cos(turn) - north * sin(turn),
                centre[1] + east * sin(turn) + north * cos(turn),
            )
        case Waypoints():
            return _along(motion, start, motion.speed_m_s * time_s)
        case Replay():
            return _recorded(motion, time_s)


def _along(motion: Waypoints, start: Point, way_m: float) -> Point:
    path = (start, *motion.points)
    if motion.ending is Ending.LOOP:
        path = (*path, start)
    lengths = [hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(path)]
    total = sum(lengths)
    if motion.ending is Ending.LOOP and total > 0.0:
        way_m %= total
    for (a, b), length in zip(pairwise(path), lengths, strict=True):
        if way_m < length:
            share = way_m / length
            return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
        way_m -= length
    return path[-1]


def _recorded(motion: Replay, time_s: float) -> Point:
    times, places = motion.times_s, motion.positions
    # Searched, not walked through: tracks are long, and every tick looks twice.
    after = bisect_left(times, time_s)
    if after == 0:
        return places[0]
    if after == len(times):
        return places[-1]
    a, b = places[after - 1 : after + 1]
    share = (time_s - times[after - 1]) / (times[after] - times[after - 1])
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
