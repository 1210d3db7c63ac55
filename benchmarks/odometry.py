"""A robot that flies about with noisy sensors: truth by other formulas than the filter's.

Attitudes are scipy's. The model: white noise on every odometry pose (5 cm, 0.01 rad), a frame of
the odometry that drifts as a random walk (2 cm and 0.002 rad per root second), an IMU with white
noise and walking biases, tags of known place seen with 5 cm of noise.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from solver.arrays import FloatArray
from vehicles.localization.measurements import Imu, Odometry, TagSighting
from vehicles.localization.ukf import PoseNoise
from vehicles.mavlink.frames import Alignment

IMU_HZ = 150
ODOMETRY_EVERY = 5
DT_S = 1.0 / IMU_HZ
GRAVITY = np.array([0.0, 0.0, -9.80665])
TAGS = {
    number: np.array(place)
    for number, place in enumerate(
        [(5.0, 0.0, 1.0), (-4.0, 4.0, 0.5), (0.0, -6.0, 1.5), (3.0, 5.0, 0.0)]
    )
}
TAG_NOISE_M = 0.05
REGISTERED = np.diag([0.03, 0.03, 0.03, 0.02]) ** 2
"""Covariance of the registration the filter starts with."""


def quaternion(rotation: Rotation) -> FloatArray:
    """Return (w, x, y, z)."""
    return np.asarray(rotation.as_quat()[[3, 0, 1, 2]], dtype=np.float64)


def rotation(q: FloatArray) -> Rotation:
    """Return scipy's rotation of (w, x, y, z)."""
    return Rotation.from_quat(np.asarray(q)[[1, 2, 3, 0]])


@dataclass(frozen=True)
class Moment:
    """One step of the IMU and all that was measured at its end, with the truth then."""

    imu: Imu
    odometry: Odometry | None
    sighting: TagSighting | None
    position: FloatArray
    velocity: FloatArray
    attitude: Rotation
    force_bias: FloatArray
    rate_bias: FloatArray
    shift: FloatArray
    yaw: float


class Flight:
    """One flight; its dice are its own."""

    def __init__(self, seed: int, noise: PoseNoise | None = None) -> None:
        self.noise = noise or PoseNoise()
        self._dice = np.random.default_rng(seed)
        dice, n = self._dice, self.noise
        self.registered = Alignment((2.0, -1.0, 0.5), 0.7)
        error = dice.multivariate_normal(np.zeros(4), REGISTERED)
        self.shift = np.array(self.registered.shift) + error[:3]
        self.yaw = self.registered.yaw_rad + error[3]
        self.force_bias = dice.normal(0.0, n.start_force_bias, 3)
        self.rate_bias = dice.normal(0.0, n.start_rate_bias, 3)
        self.position = np.array([0.0, 0.0, 2.0])
        self.velocity = dice.normal(0.0, n.start_velocity, 3)
        self.attitude = Rotation.from_euler("zyx", [0.4, 0.05, -0.05])
        self._phases = dice.uniform(0.0, 2.0 * np.pi, (3, 2))
        self._time_s = 0.0

    def odometry(self) -> Odometry:
        """Return what the odometry says now."""
        n, dice = self.noise, self._dice
        turn = Rotation.from_euler("z", self.yaw)
        place = turn.inv().apply(self.position - self.shift) + dice.normal(0.0, n.odometry_m, 3)
        error = Rotation.from_rotvec(dice.normal(0.0, n.odometry_rad, 3))
        return Odometry(place, quaternion(turn.inv() * self.attitude * error))

    def sighting(self) -> TagSighting:
        """Return the sighting of one of the tags."""
        number = int(self._dice.integers(len(TAGS)))
        offset = self.attitude.inv().apply(TAGS[number] - self.position)
        noisy = offset + self._dice.normal(0.0, TAG_NOISE_M, 3)
        return TagSighting(number, noisy, TAG_NOISE_M**2 * np.eye(3))

    def moments(self, seconds: float, tag_every_s: float = 1.0) -> Iterator[Moment]:
        """Yield the flight step by step."""
        tag_every = round(tag_every_s * IMU_HZ)
        for number in range(1, round(seconds * IMU_HZ) + 1):
            imu = self._step()
            yield Moment(
                imu,
                self.odometry() if number % ODOMETRY_EVERY == 0 else None,
                self.sighting() if number % tag_every == 0 else None,
                self.position,
                self.velocity,
                self.attitude,
                self.force_bias,
                self.rate_bias,
                self.shift,
                self.yaw,
            )

    def _step(self) -> Imu:
        """Move on and return what the IMU averages over the step."""
        n, dice, middle_s = self.noise, self._dice, self._time_s + DT_S / 2.0
        waves = np.array([0.8, 0.7, 0.3])[:, None] * np.array([1.0, 0.4])
        pull = (waves * np.cos(np.array([0.9, 2.3]) * middle_s + self._phases)).sum(axis=1)
        pull -= 0.3 * self.velocity + 0.1 * (self.position - [0.0, 0.0, 2.0])
        rate = np.array([0.3, 0.25, 0.5]) * np.sin(np.array([1.3, 1.1, 0.5]) * middle_s)
        middle = self.attitude * Rotation.from_rotvec(rate * DT_S / 2.0)
        force = middle.inv().apply(pull - GRAVITY)
        self.position = self.position + DT_S * self.velocity + 0.5 * DT_S**2 * pull
        self.velocity = self.velocity + DT_S * pull
        self.attitude = self.attitude * Rotation.from_rotvec(rate * DT_S)
        self._time_s += DT_S
        root = np.sqrt(DT_S)
        measured = Imu(
            force + self.force_bias + dice.normal(0.0, n.force / root, 3),
            rate + self.rate_bias + dice.normal(0.0, n.rate / root, 3),
        )
        self.force_bias = self.force_bias + dice.normal(0.0, n.force_walk * root, 3)
        self.rate_bias = self.rate_bias + dice.normal(0.0, n.rate_walk * root, 3)
        self.shift = self.shift + dice.normal(0.0, n.drift_m * root, 3)
        self.yaw = self.yaw + dice.normal(0.0, n.drift_rad * root)
        return measured
