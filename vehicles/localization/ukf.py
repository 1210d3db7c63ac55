"""The pose of one robot: an unscented filter over odometry, IMU and tags.

State, 19 numbers: position p and velocity v in the common frame, attitude q (as a rotation vector
about a reference that moves along), biases of accelerometer and gyroscope, and the alignment
(t, psi) of the odometry frame, which drifts:

    p' = v,  v' = R(q) (f - b_a) + g,  q' = q o (w - b_w),  b_a, b_w, t, psi: random walks
    odometry:  R_z(psi)' (p - t) + noise,  q_z(psi)* q o noise
    tag at m:  R(q)' (m - p) + noise

The odometry's error is white noise plus the drift of its frame; tags see the drift, so the filter
can take it out. The IMU moves the belief at its own rate; odometry and tags correct it when they
come. An outlier is left out; odometry that is an outlier for a whole while has started anew, and
its frame is laid anew.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from solver.arrays import FloatArray
from vehicles.localization import rotations
from vehicles.localization.measurements import Imu, Odometry, Pose, TagSighting
from vehicles.localization.sigma import Model, UnscentedFilter
from vehicles.mavlink.frames import Alignment

GRAVITY = np.array([0.0, 0.0, -9.80665])
SIZE = 19
P, V, TURN, FORCE_BIAS, RATE_BIAS, SHIFT, YAW = (
    slice(0, 3),
    slice(3, 6),
    slice(6, 9),
    slice(9, 12),
    slice(12, 15),
    slice(15, 18),
    slice(18, 19),
)
"""Where each part stands in the state."""

_REST = slice(9, 19)
"""Parts that an IMU step leaves alone."""


class Outcome(StrEnum):
    """What became of a measurement."""

    TAKEN = "taken"
    OUTLIER = "outlier"
    ANCHORED = "anchored"
    """The odometry had started anew; its frame was laid anew."""


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """How good sensors and start are; per root hertz where it says so."""

    force: float = 0.05
    """m/s^2 per root hertz."""

    rate: float = 0.003
    """rad/s per root hertz."""

    force_walk: float = 0.002
    """m/s^2 per root second."""

    rate_walk: float = 0.0002
    """rad/s per root second."""

    odometry_m: float = 0.05
    odometry_rad: float = 0.01
    drift_m: float = 0.02
    """m per root second, of the odometry's frame."""

    drift_rad: float = 0.002
    """rad per root second, about the vertical."""

    start_velocity: float = 0.5
    start_force_bias: float = 0.1
    start_rate_bias: float = 0.01
    gate_probability: float = 0.999
    """A measurement less likely than this leaves room for is an outlier."""

    restart_after: int = 15
    """Odometry that is an outlier so many times running has started anew."""


class PoseFilter:
    """Where one robot is. `start` it, then feed it.

    Args:
        noise: How good its sensors are.
    """

    def __init__(self, noise: PoseNoise) -> None:
        self._noise = noise
        self._filter = UnscentedFilter(SIZE)
        self._reference = np.array(rotations.IDENTITY)
        self._outliers = 0
        self._blind_s = 0.0
        self._noise_step_s = 0.0
        self._gates = {k: float(chdtri(k, 1.0 - noise.gate_probability)) for k in (3, 6)}

    def start(self, odometry: Odometry, alignment: Alignment, covariance: FloatArray) -> None:
        """Begin where the odometry is, its frame lying as registered.

        Args:
            odometry: The first pose, at rest or nearly so.
            alignment: Of the odometry's frame.
            covariance: Of (east, north, up, psi), shape (4, 4).
        """
        noise, belief = self._noise, self._filter
        self._reference = rotations.product(
            rotations.about_up(np.array(alignment.yaw_rad)), odometry.attitude
        )
        belief.x = np.zeros(SIZE)
        belief.x[SHIFT], belief.x[YAW] = alignment.shift, alignment.yaw_rad
        deviations = np.repeat(
            [
                noise.odometry_m,
                noise.start_velocity,
                noise.odometry_rad,
                noise.start_force_bias,
                noise.start_rate_bias,
            ],
            3,
        )
        belief.P = np.zeros((SIZE, SIZE))
        belief.P[:15, :15] = np.diag(deviations**2)
        belief.P[15:, 15:] = covariance

        def placed(states: FloatArray) -> FloatArray:
            """Turn the odometry's errors, which stand in p and q, into pose."""
            result, turn = states.copy(), rotations.about_up(states[:, 18])
            there = rotations.turned(turn, odometry.position + states[:, P])
            result[:, P] = there + states[:, SHIFT]
            read = rotations.product(odometry.attitude, rotations.of_vector(states[:, TURN]))
            result[:, TURN] = self._away(rotations.product(turn, read))
            return result

        belief.transform(placed, np.zeros((SIZE, SIZE)))
        self._settle()
        self._outliers, self._blind_s = 0, 0.0

    # ------------------------------------------------------------------ what comes in

    def propagate(self, imu: Imu, dt_s: float) -> Pose:
        """Move on by one step of the IMU and return the pose after it."""
        belief, reference = self._filter, self._reference
        mean_rate = imu.rate - belief.x[RATE_BIAS]
        reference_after = rotations.product(reference, rotations.of_vector(mean_rate * dt_s))
        opposite = rotations.conjugate(reference_after)

        def moved(states: FloatArray) -> FloatArray:
            before = rotations.product(reference, rotations.of_vector(states[:, TURN]))
            half = 0.5 * dt_s * (imu.rate - states[:, RATE_BIAS])
            midway = rotations.product(before, rotations.of_vector(half))
            after = rotations.product(midway, rotations.of_vector(half))
            pull = rotations.turned(midway, imu.force - states[:, FORCE_BIAS]) + GRAVITY
            result = np.empty_like(states)
            result[:, P] = states[:, P] + dt_s * states[:, V] + 0.5 * dt_s**2 * pull
            result[:, V] = states[:, V] + dt_s * pull
            result[:, TURN] = rotations.vector_of(rotations.product(opposite, after))
            result[:, _REST] = states[:, _REST]
            return result

        if dt_s != self._noise_step_s:
            belief.Q, self._noise_step_s = self._process_noise(dt_s), dt_s
        belief.predict(dt=dt_s, fx=moved)
        self._reference = reference_after
        self._settle()
        self._blind_s += dt_s
        return self.pose()

    def observe(self, odometry: Odometry) -> Outcome:
        """Take what the odometry says now."""
        noise = self._noise
        opposite = rotations.conjugate(odometry.attitude)

        def expected(states: FloatArray) -> FloatArray:
            back = rotations.about_up(-states[:, 18])
            place = rotations.turned(back, states[:, P] - states[:, SHIFT])
            read = rotations.product(back, self._attitudes(states))
            off = rotations.vector_of(rotations.product(opposite, read))
            return np.concatenate((place, off), axis=1)

        z = np.concatenate((odometry.position, np.zeros(3)))
        variances = np.repeat([noise.odometry_m**2, noise.odometry_rad**2], 3)
        if self._take(z, np.diag(variances), expected):
            self._outliers = 0
            return Outcome.TAKEN
        self._outliers += 1
        if self._outliers < noise.restart_after:
            return Outcome.OUTLIER
        self._anchor(odometry)
        return Outcome.ANCHORED

    def sight(self, sighting: TagSighting, place: ArrayLike) -> Outcome:
        """Take the sighting of a tag whose place in the common frame is known."""
        there = np.asarray(place, dtype=np.float64)

        def expected(states: FloatArray) -> FloatArray:
            back = rotations.conjugate(self._attitudes(states))
            return rotations.turned(back, there - states[:, P])

        taken = self._take(sighting.offset, sighting.covariance, expected)
        return Outcome.TAKEN if taken else Outcome.OUTLIER

    # ------------------------------------------------------------------ what is known

    def pose(self) -> Pose:
        """Return where the robot is now."""
        x = self._filter.x
        return Pose(
            position=x[P].copy(),
            velocity=x[V].copy(),
            attitude=self._reference.copy(),
            covariance=self._filter.P[P, P].copy(),
            blind_s=self._blind_s,
        )

    def alignment(self) -> Alignment:
        """Return how the odometry's frame lies now; its `to_local` takes way-points there."""
        east, north, up = (float(number) for number in self._filter.x[SHIFT])
        return Alignment((east, north, up), float(self._filter.x[18]))

    def belief(self) -> tuple[FloatArray, FloatArray]:
        """Return the state (19,) with a zero attitude part, and its covariance (19, 19)."""
        return self._filter.x.copy(), self._filter.P.copy()

    # ------------------------------------------------------------------ inside

    def _take(self, z: FloatArray, noise: FloatArray, expected: Model) -> bool:
        belief = self._filter
        if not belief.absorb(z, noise, expected, self._gates[len(z)]):
            return False
        self._settle()
        belief.refresh()
        self._blind_s = 0.0
        return True

    def _settle(self) -> None:
        """Move the mean turn into the reference, so that the state's turn stays small."""
        belief = self._filter
        turn = belief.x[TURN].copy()
        turned = rotations.product(self._reference, rotations.of_vector(turn))
        self._reference = turned / math.sqrt(turned @ turned)
        belief.x[TURN] = 0.0
        belief.sigmas_f[:, TURN] -= turn

    def _attitudes(self, states: FloatArray) -> FloatArray:
        return rotations.product(self._reference, rotations.of_vector(states[:, TURN]))

    def _away(self, attitudes: FloatArray) -> FloatArray:
        """Return attitudes as rotation vectors about the reference."""
        opposite = rotations.conjugate(self._reference)
        return rotations.vector_of(rotations.product(opposite, attitudes))

    def _anchor(self, odometry: Odometry) -> None:
        """Lay the odometry's frame so that it says what is believed; the pose stays."""

        def laid(states: FloatArray) -> FloatArray:
            result = states.copy()
            turn = rotations.product(
                self._attitudes(states), rotations.conjugate(odometry.attitude)
            )
            yaw = rotations.yaw_of(turn)
            there = rotations.turned(rotations.about_up(yaw), odometry.position)
            result[:, SHIFT] = states[:, P] - there
            # About the mean, so that no point wraps round.
            result[:, 18] = yaw[0] + (yaw - yaw[0] + np.pi) % (2.0 * np.pi) - np.pi
            return result

        # An error of the turn swings the shift about the vehicle's place in the odometry's frame.
        turn = rotations.product(self._reference, rotations.conjugate(odometry.attitude))
        east, north, _ = rotations.turned(
            rotations.about_up(rotations.yaw_of(turn)), odometry.position
        )
        swing = np.array([north, -east, 0.0, 1.0])
        noise = np.zeros((SIZE, SIZE))
        noise[SHIFT, SHIFT] = self._noise.odometry_m**2 * np.eye(3)
        noise[15:, 15:] += self._noise.odometry_rad**2 * np.outer(swing, swing)
        self._filter.transform(laid, noise)
        self._settle()
        self._outliers, self._blind_s = 0, 0.0

    def _process_noise(self, dt_s: float) -> FloatArray:
        """Return the covariance of what the state gains in chance over one step."""
        noise, q = self._noise, np.zeros((SIZE, SIZE))
        force, each = noise.force**2, np.arange(3)
        q[each, each] = force * dt_s**3 / 3.0
        q[each, each + 3] = q[each + 3, each] = force * dt_s**2 / 2.0
        q[each + 3, each + 3] = force * dt_s
        walks = [noise.rate, noise.force_walk, noise.rate_walk, noise.drift_m]
        diagonal = np.repeat(np.square(walks) * dt_s, 3)
        q[range(6, 18), range(6, 18)] = diagonal
        q[18, 18] = noise.drift_rad**2 * dt_s
        return q
