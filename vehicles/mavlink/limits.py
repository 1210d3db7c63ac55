"""What a setpoint must keep to before it may reach an autopilot, and where it leads meanwhile."""

import math
from dataclasses import dataclass

from solver.setpoints import Setpoint
from solver.zones import Point
from vehicles.mavlink.frames import Vector

STANDING_M_S = 1e-3
"""Slower than this is standing."""

MAX_TTL_S = 10.0

SETTLE_S = 1.0
"""Who is to stand somewhere may be as far from there as it flies in this time at its limit: on
the way it keeps to the autopilot's own speed, of which a setpoint that stands says nothing."""


@dataclass(frozen=True, slots=True)
class FlightLimits:
    """The last word on where a vehicle may be sent, in the common frame.

    Raises:
        ValueError: The limits leave no room.
    """

    speed_m_s: float = 5.0
    leap_m: float = 20.0
    """Farthest a way-point may be from the vehicle."""

    field_lower: Point = (-1e5, -1e5)
    field_upper: Point = (1e5, 1e5)
    altitude_lower_m: float = 0.5
    altitude_upper_m: float = 120.0
    battery_least: float = 0.2
    """Charge at which the battery is called low."""

    def __post_init__(self) -> None:
        """Check that there is room; NaN leaves none."""
        ordered = all(
            low < high for low, high in zip(self.field_lower, self.field_upper, strict=True)
        )
        if not (ordered and 0.0 < self.altitude_lower_m <= self.altitude_upper_m):
            raise ValueError("the flight limits leave no room")
        if not (self.speed_m_s > 0.0 and self.leap_m > 0.0 and 0.0 <= self.battery_least < 1.0):
            raise ValueError("speed and leap must be above 0, the least battery in [0, 1)")

    def objection(self, setpoint: Setpoint, position: Point) -> str | None:
        """Return why a setpoint may not be flown from a position, None if it may.

        A vehicle outside the field may be sent anywhere that is not farther outside.
        """
        numbers = (*setpoint.velocity, *setpoint.waypoint, setpoint.altitude_m, setpoint.ttl_s)
        if not all(map(math.isfinite, numbers)):
            return "a number is not finite"
        if not 0.0 < setpoint.ttl_s <= MAX_TTL_S:
            return f"life time {setpoint.ttl_s:g} s"
        if math.hypot(*setpoint.velocity) > self.speed_m_s * (1.0 + 1e-6):
            return f"faster than {self.speed_m_s:g} m/s"
        way_m = math.dist(setpoint.waypoint, position)
        if way_m > self.leap_m:
            return f"way-point farther than {self.leap_m:g} m"
        if math.hypot(*setpoint.velocity) < STANDING_M_S and way_m > self.speed_m_s * SETTLE_S:
            return f"to stand {way_m:.1f} m away, and no speed to get there"
        if not self.altitude_lower_m <= setpoint.altitude_m <= self.altitude_upper_m:
            return f"altitude {setpoint.altitude_m:g} m"
        if self._outside_m(setpoint.waypoint) > self._outside_m(position) + 1e-6:
            return "way-point outside the field"
        return None

    def _outside_m(self, place: Point) -> float:
        """Return how far a place lies outside the field, 0 inside."""
        bounds = zip(place, self.field_lower, self.field_upper, strict=True)
        return math.hypot(*(max(low - x, 0.0, x - high) for x, low, high in bounds))


@dataclass(frozen=True, slots=True)
class Leg:
    """A setpoint being flown: from where it was taken towards its way-point."""

    setpoint: Setpoint
    start: Point
    taken_s: float

    @property
    def until_s(self) -> float:
        """When it expires."""
        return self.taken_s + self.setpoint.ttl_s

    def reference(self, now_s: float) -> tuple[Vector, Vector]:
        """Return where the vehicle should be now, and its velocity, in the common frame.

        The autopilots add the velocity to what they make of the distance to the position, so a
        position ahead of the vehicle would be flown too fast: the reference starts where the
        vehicle was and moves at the setpoint's speed until it is at the way-point.
        """
        waypoint, altitude_m = self.setpoint.waypoint, self.setpoint.altitude_m
        speed, length = math.hypot(*self.setpoint.velocity), math.dist(self.start, waypoint)
        part = speed * max(now_s - self.taken_s, 0.0) / length if length > 0.0 else 1.0
        if speed < STANDING_M_S or part >= 1.0:
            return (*waypoint, altitude_m), (0.0, 0.0, 0.0)
        x, y = (a + part * (b - a) for a, b in zip(self.start, waypoint, strict=True))
        return (x, y, altitude_m), (*self.setpoint.velocity, 0.0)
