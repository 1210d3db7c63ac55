"""Where one robot is, from nothing: tags register its odometry, then the pose filter takes over.

For robots with a camera, an IMU and visual-inertial odometry of their own. Sans-I/O; everything is
fed in the order in which it was measured.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from vehicles.localization.measurements import Imu, Odometry, Pose, Stance, TagSighting
from vehicles.localization.registration import landmark
from vehicles.localization.seeking import Seeker, SeekSettings, Sighted
from vehicles.localization.ukf import TURN, Outcome, PoseFilter, PoseNoise
from vehicles.mavlink.frames import Alignment


class Localizer:
    """Owner of what one robot knows of its place.

    Args:
        places: Places of the known tags in the common frame, by id, metres.
        noise: How good its sensors are.
        settings: When a registration is believed, and when it is given up.
    """

    def __init__(
        self,
        places: Mapping[int, Sequence[float]],
        noise: PoseNoise,
        settings: SeekSettings,
    ) -> None:
        self._places = dict(places)
        self._noise, self._settings = noise, settings
        self._seeker = Seeker(settings)
        self._filter: PoseFilter | None = None
        self._odometry: Odometry | None = None
        self._outliers = 0

    @property
    def reason(self) -> str:
        """Why its place is not known, empty once it is."""
        return self._seeker.reason

    def propagate(self, imu: Imu, dt_s: float) -> Pose | None:
        """Move on by one step of the IMU; return the pose after it, None while it is not known."""
        return None if self._filter is None else self._filter.propagate(imu, dt_s)

    def observe(self, odometry: Odometry) -> Outcome | None:
        """Take what the odometry says now; None while the place is not known."""
        self._odometry = odometry
        return None if self._filter is None else self._filter.observe(odometry)

    def sight(self, sighting: TagSighting) -> Sighted:
        """Take the sighting of a tag."""
        place = self._places.get(sighting.tag_id)
        if place is None or self._odometry is None:
            return Sighted.IGNORED
        if self._filter is None:
            return self._seek(sighting, self._odometry)
        if self._filter.sight(sighting, place) is Outcome.TAKEN:
            self._outliers = 0
            return Sighted.TAKEN
        self._outliers += 1
        if self._outliers < self._settings.lost_after:
            return Sighted.OUTLIER
        self._filter = None
        self._seeker.start_over("the tags are not where they should be")
        return Sighted.LOST

    def pose(self) -> Pose | None:
        """Return where the robot is now, None while that is not known."""
        return None if self._filter is None else self._filter.pose()

    def alignment(self) -> Alignment | None:
        """Return how the odometry's frame lies now; its `to_local` takes way-points there."""
        return None if self._filter is None else self._filter.alignment()

    def stance(self, now_s: float) -> Stance | None:
        """Return where the camera looks from; the time does not matter, all is as last fed."""
        if self._filter is None:
            return None
        pose, (_, P) = self._filter.pose(), self._filter.belief()
        variance = float(np.linalg.eigvalsh(P[TURN, TURN])[-1])
        return Stance(pose.position, pose.attitude, variance)

    def _seek(self, sighting: TagSighting, odometry: Odometry) -> Sighted:
        noise = self._noise
        swing = noise.odometry_rad**2 * float(sighting.offset @ sighting.offset)
        mark = landmark(sighting, odometry, noise.odometry_m**2 + swing, self._places)
        found = None if mark is None else self._seeker.add(mark)
        if found is None:
            return Sighted.KEPT
        self._filter = PoseFilter(noise)
        self._filter.start(odometry, found.alignment, found.covariance)
        self._outliers = 0
        return Sighted.REGISTERED
