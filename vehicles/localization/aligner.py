"""A MAVLink vehicle's local frame laid into the common frame by the tags it sees.

The autopilot's local position and attitude are the odometry: smooth, but of a frame that starts
anywhere and drifts where there is no satellite. A camera beside it sees tags whose places are
known; they register the frame and keep it registered. This is the `vehicles.mavlink.alignment`
seam: a `Session` takes it as its aligner, and whoever looks through the camera calls `sight`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from solver.arrays import FloatArray
from vehicles.localization import rotations
from vehicles.localization.drift import Drift, DriftFilter
from vehicles.localization.measurements import Odometry, Stance, TagSighting
from vehicles.localization.registration import landmark
from vehicles.localization.seeking import Seeker, SeekSettings, Sighted
from vehicles.mavlink.frames import Alignment
from vehicles.mavlink.telemetry import Telemetry

FRESH_S = 0.3
"""Position and attitude no older than this say where a tag was seen from."""


@dataclass(frozen=True, slots=True)
class TagAlignerSettings:
    """How good the vehicle's own estimate is, and how its frame wanders."""

    seek: SeekSettings = field(default_factory=SeekSettings)
    drift: Drift = field(default_factory=Drift)
    position_m: float = 0.05
    """Standard deviation of a local position, per axis, its drift left out."""

    attitude_rad: float = 0.02
    """Standard deviation of an attitude, per axis."""


class TagAligner:
    """The alignment by tags: `vehicles.mavlink.alignment.Aligner`.

    Args:
        places: Places of the known tags in the common frame, by id, metres.
        settings: How good what it is fed with is.
    """

    def __init__(self, places: Mapping[int, Sequence[float]], settings: TagAlignerSettings) -> None:
        self._places = dict(places)
        self._settings = settings
        self._seeker = Seeker(settings.seek)
        self._tracked: DriftFilter | None = None
        self._told: Telemetry | None = None
        self._moved_s = 0.0
        self._outliers = 0

    @property
    def alignment(self) -> Alignment | None:
        """The alignment, None until it is known."""
        return None if self._tracked is None else self._tracked.alignment

    @property
    def covariance(self) -> FloatArray | None:
        """Of (east, north, up, psi), shape (4, 4), None until it is known."""
        return None if self._tracked is None else self._tracked.covariance

    @property
    def reason(self) -> str:
        """Why the alignment is not known, empty once it is."""
        return self._seeker.reason

    def observe(self, telemetry: Telemetry) -> None:
        """Take what the vehicle has told so far."""
        self._told = telemetry

    def sight(self, sighting: TagSighting, now_s: float) -> Sighted:
        """Take the sighting of a tag, from the body.

        Args:
            sighting: As a `TagDetector` makes them.
            now_s: When the picture was taken, on the session's clock.
        """
        odometry = self._odometry(now_s)
        if odometry is None:
            return Sighted.IGNORED
        settings = self._settings
        swing = settings.attitude_rad**2 * float(sighting.offset @ sighting.offset)
        mark = landmark(sighting, odometry, settings.position_m**2 + swing, self._places)
        if mark is None:
            return Sighted.IGNORED
        if self._tracked is None:
            found = self._seeker.add(mark)
            if found is None:
                return Sighted.KEPT
            self._tracked = DriftFilter(found, settings.drift)
            self._moved_s, self._outliers = now_s, 0
            return Sighted.REGISTERED
        self._tracked.wait(now_s - self._moved_s)
        self._moved_s = now_s
        if self._tracked.sight(mark):
            self._outliers = 0
            return Sighted.TAKEN
        self._outliers += 1
        if self._outliers < settings.seek.lost_after:
            return Sighted.OUTLIER
        self._tracked = None
        self._seeker.start_over("the tags are not where they should be: its frame has jumped")
        return Sighted.LOST

    def stance(self, now_s: float) -> Stance | None:
        """Return where the vehicle is and how it is turned, None while that is not known."""
        odometry, alignment = self._odometry(now_s), self.alignment
        if odometry is None or alignment is None:
            return None
        x, y, z = (float(number) for number in odometry.position)
        turn = rotations.about_up(np.array(alignment.yaw_rad))
        covariance = self.covariance
        drift = 0.0 if covariance is None else float(covariance[3, 3])
        return Stance(
            position=np.array(alignment.to_common((x, y, z))),
            attitude=rotations.product(turn, odometry.attitude),
            attitude_variance=self._settings.attitude_rad**2 + drift,
        )

    def _odometry(self, now_s: float) -> Odometry | None:
        """Return the vehicle's pose in its local frame, None where it is not fresh."""
        told = self._told
        if told is None or told.position_s is None or told.attitude_s is None:
            return None
        if now_s - min(told.position_s, told.attitude_s) > FRESH_S:
            return None
        # Its angles are those of a body that looks forward, right and down.
        heading = rotations.about_up(np.array(told.yaw_rad))
        pitch = rotations.of_vector(np.array([0.0, -told.pitch_rad, 0.0]))
        roll = rotations.of_vector(np.array([told.roll_rad, 0.0, 0.0]))
        attitude = rotations.product(heading, rotations.product(pitch, roll))
        return Odometry(np.array(told.position_at(now_s)), attitude)
