"""Frames: ENU here, NED there, latitude and longitude, and the vehicle's own local frame.

The common frame of a team is ENU, tangent to the WGS84 ellipsoid at a *datum*. An autopilot
reports NED metres from an origin of its own choice; an `Alignment` (a shift and a turn about
the vertical) takes its local ENU to the common frame.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

Vector: TypeAlias = tuple[float, float, float]
"""Three numbers along the axes of a frame, usually metres or metres per second."""

_SEMI_MAJOR_M = 6_378_137.0
_FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY2 = _FLATTENING * (2.0 - _FLATTENING)
_ROUNDS = 5
"""Of the fixed-point iteration for latitude and longitude; each gains over four digits within
100 km of the datum."""


def flipped(vector: Vector) -> Vector:
    """Return an ENU vector in NED, or a NED vector in ENU; it is the same change."""
    return (vector[1], vector[0], -vector[2])


def heading_of_yaw(yaw_rad: float) -> float:
    """Return the compass heading of an ENU yaw, or the yaw of a heading, in (-pi, pi]."""
    return wrapped(math.pi / 2.0 - yaw_rad)


def wrapped(angle_rad: float) -> float:
    """Return an angle brought into (-pi, pi]."""
    return -((math.pi - angle_rad) % (2.0 * math.pi) - math.pi)


@dataclass(frozen=True, slots=True)
class Datum:
    """Where the common frame touches the Earth (WGS84).

    Raises:
        ValueError: It is no place on Earth, or so near a pole that east means nothing.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0
    """Metres, of the same kind (above mean sea level) as the autopilots report."""

    def __post_init__(self) -> None:
        """Check the place."""
        if not (abs(self.latitude_deg) <= 89.0 and abs(self.longitude_deg) <= 180.0):
            raise ValueError("a datum needs a latitude within 89 and a longitude within 180 deg")
        if not abs(self.altitude_m) <= 1e5:
            raise ValueError("a datum needs an altitude within 100 km")

    def enu(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vector:
        """Return a place in the common frame, metres, exact by way of ECEF."""
        here = _ecef(latitude_deg, longitude_deg, altitude_m)
        zero = _ecef(self.latitude_deg, self.longitude_deg, self.altitude_m)
        x, y, z = (a - b for a, b in zip(here, zero, strict=True))
        phi, lam = math.radians(self.latitude_deg), math.radians(self.longitude_deg)
        outward = math.cos(lam) * x + math.sin(lam) * y
        return (
            -math.sin(lam) * x + math.cos(lam) * y,
            -math.sin(phi) * outward + math.cos(phi) * z,
            math.cos(phi) * outward + math.sin(phi) * z,
        )

    def geodetic(self, place: Vector) -> Vector:
        """Return latitude (deg), longitude (deg) and altitude (m) of a place of the frame."""
        phi = math.radians(self.latitude_deg)
        w2 = 1.0 - _ECCENTRICITY2 * math.sin(phi) ** 2
        normal = _SEMI_MAJOR_M / math.sqrt(w2)
        meridian = normal * (1.0 - _ECCENTRICITY2) / w2
        latitude, longitude, altitude = self.latitude_deg, self.longitude_deg, self.altitude_m
        for _ in range(_ROUNDS):
            east, north, up = self.enu(latitude, longitude, altitude)
            latitude += math.degrees((place[1] - north) / meridian)
            longitude += math.degrees((place[0] - east) / (normal * math.cos(phi)))
            altitude += place[2] - up
        return latitude, longitude, altitude


@dataclass(frozen=True, slots=True)
class Alignment:
    """How a vehicle's local ENU frame lies in the common frame: turned, then shifted."""

    shift: Vector = (0.0, 0.0, 0.0)
    """The local origin in the common frame, metres."""

    yaw_rad: float = 0.0
    """Anticlockwise turn from common east to the local first axis."""

    def to_common(self, place: Vector) -> Vector:
        """Return a local place in the common frame."""
        x, y, z = self.turned(place)
        return (x + self.shift[0], y + self.shift[1], z + self.shift[2])

    def to_local(self, place: Vector) -> Vector:
        """Return a place of the common frame in the local one."""
        x, y, z = (a - b for a, b in zip(place, self.shift, strict=True))
        return self.turned_back((x, y, z))

    def turned(self, vector: Vector) -> Vector:
        """Return a local direction or velocity in the common frame."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return (c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2])

    def turned_back(self, vector: Vector) -> Vector:
        """Return a direction or velocity of the common frame in the local one."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return (c * vector[0] + s * vector[1], -s * vector[0] + c * vector[1], vector[2])


def _ecef(latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vector:
    """Return Earth-centred, Earth-fixed metres of a place (WGS84)."""
    phi, lam = math.radians(latitude_deg), math.radians(longitude_deg)
    normal = _SEMI_MAJOR_M / math.sqrt(1.0 - _ECCENTRICITY2 * math.sin(phi) ** 2)
    return (
        (normal + altitude_m) * math.cos(phi) * math.cos(lam),
        (normal + altitude_m) * math.cos(phi) * math.sin(lam),
        (normal * (1.0 - _ECCENTRICITY2) + altitude_m) * math.sin(phi),
    )
