"""Where a vehicle's local frame lies in the common frame.

By the team's datum, from the best of what the autopilot tells: the latitude and longitude of its
local origin; of home, with home's local place; or of the vehicle, beside its local position.
Without a datum (indoors) it is given: by a registration of tags, or by whoever set the frames up.
Autopilots point their local north to true north, so nothing turns unless a registration says so.
"""

from collections import deque
from enum import StrEnum
from statistics import fmean
from typing import Protocol

from vehicles.mavlink.frames import Alignment, Datum, Vector
from vehicles.mavlink.telemetry import Telemetry

PAIRS = 10
"""Pairs of local and global position averaged where nothing better is told."""

MAX_APART_MS = 100
"""How far apart in time such a pair may be, at rest or nearly so."""

MAX_PAIR_SPEED_M_S = 0.5


class Heights(StrEnum):
    """What altitudes of the common frame are measured from."""

    OWN_ORIGIN = "own_origin"
    """The vehicle's own origin: its barometer's zero, usually the ground it started from."""

    DATUM = "datum"
    """The altitude of the datum."""


class Aligner(Protocol):
    """Finds how a vehicle's local frame lies in the common one."""

    @property
    def alignment(self) -> Alignment | None:
        """The alignment, None until it is known."""
        ...

    def observe(self, telemetry: Telemetry) -> None:
        """Take what the vehicle has told so far."""
        ...


class GivenAlignment:
    """An alignment known beforehand, or set anew by a registration."""

    def __init__(self, alignment: Alignment | None) -> None:
        self.alignment = alignment

    def observe(self, telemetry: Telemetry) -> None:
        """Learn nothing."""


class DatumAlignment:
    """The alignment by latitude and longitude."""

    def __init__(self, datum: Datum, heights: Heights = Heights.OWN_ORIGIN) -> None:
        self._datum = datum
        self._heights = heights
        self._origin: Vector | None = None
        self._pairs: deque[Vector] = deque(maxlen=PAIRS)
        self._paired_ms: int | None = None

    @property
    def alignment(self) -> Alignment | None:
        """The alignment, None until it is known."""
        origin = self._origin
        if origin is None and len(self._pairs) == PAIRS:
            east, north, up = (fmean(axis) for axis in zip(*self._pairs, strict=True))
            origin = (east, north, up)
        if origin is None:
            return None
        up = origin[2] if self._heights is Heights.DATUM else 0.0
        return Alignment(shift=(origin[0], origin[1], up))

    def observe(self, telemetry: Telemetry) -> None:
        """Take what the vehicle has told so far; a told origin overrules all else."""
        if telemetry.origin is not None:
            self._origin = self._datum.enu(*telemetry.origin)
        elif telemetry.home is not None:
            place, local = telemetry.home
            self._origin = _minus(self._datum.enu(*place), local)
        else:
            self._pair(telemetry)

    def _pair(self, telemetry: Telemetry) -> None:
        place = telemetry.global_place
        if place is None or telemetry.position_s is None:
            return
        together = abs(telemetry.global_ms - telemetry.boot_ms) <= MAX_APART_MS
        slow = max(map(abs, telemetry.velocity)) <= MAX_PAIR_SPEED_M_S
        if together and slow and telemetry.global_ms != self._paired_ms:
            self._paired_ms = telemetry.global_ms
            self._pairs.append(_minus(self._datum.enu(*place), telemetry.position))


def _minus(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
