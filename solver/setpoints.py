"""What leaves the planner for a robot."""

from dataclasses import dataclass

from solver.zones import Point


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Fly at this velocity towards this way-point until it expires, then hold."""

    robot_id: int
    velocity: Point
    """m/s, ENU."""

    waypoint: Point
    """Where the robot should be one planning step from now, metres."""

    altitude_m: float
    ttl_s: float
    """Life time, counted on the receiver's own monotonic clock."""
