"""How an odometry frame lies in the common frame, kept up as it drifts.

An extended filter (filterpy) on the four numbers of a registration, (east, north, up, psi), which
walk randomly; every tag of known place corrects them. For vehicles whose own estimator fuses IMU
and odometry already (an autopilot's does); others have `ukf.PoseFilter`, which does all in one.
"""

import math
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from scipy.special import chdtri

from solver.arrays import FloatArray
from vehicles.localization.registration import Landmark, Registration, linearized
from vehicles.mavlink.frames import Alignment


@dataclass(frozen=True, slots=True)
class Drift:
    """How fast a frame wanders, and what is too unlikely to be believed."""

    shift_m: float = 0.02
    """m per root second, per axis."""

    turn_rad: float = 0.002
    """rad per root second, about the vertical."""

    gate_probability: float = 0.999
    """A sighting less likely than this leaves room for is an outlier."""


class DriftFilter:
    """Follows a frame from its registration on.

    Args:
        registration: Where it lay at first.
        drift: How it wanders.
    """

    def __init__(self, registration: Registration, drift: Drift) -> None:
        self._drift = drift
        self._gate = float(chdtri(3, 1.0 - drift.gate_probability))
        self._filter = ExtendedKalmanFilter(dim_x=4, dim_z=3)
        alignment = registration.alignment
        self._filter.x = np.array([*alignment.shift, alignment.yaw_rad])
        self._filter.P = registration.covariance.copy()

    @property
    def alignment(self) -> Alignment:
        """How the frame lies now."""
        east, north, up, psi = (float(number) for number in self._filter.x)
        return Alignment((east, north, up), math.remainder(psi, 2.0 * math.pi))

    @property
    def covariance(self) -> FloatArray:
        """Of (east, north, up, psi), shape (4, 4), m and rad."""
        return np.array(self._filter.P)

    def wait(self, seconds: float) -> None:
        """Let time pass in which the frame may have wandered."""
        walks = np.array([self._drift.shift_m] * 3 + [self._drift.turn_rad])
        self._filter.P = self._filter.P + np.diag(walks**2) * max(seconds, 0.0)

    def sight(self, mark: Landmark) -> bool:
        """Take one landmark; tell whether it was likely enough to be believed."""
        off, derivative = linearized(mark.common[None], mark.odometry[None], self._filter.x)
        # Seen minus expected falls as the expected rises.
        H, residual = -derivative[0], off[0]
        S = H @ self._filter.P @ H.T + mark.covariance
        if float(residual @ np.linalg.solve(S, residual)) > self._gate:
            return False
        self._filter.update(
            mark.odometry, lambda _: H, lambda _: mark.odometry - residual, R=mark.covariance
        )
        return True
