"""What the filter is fed with. Metres, seconds, radians; quaternions (w, x, y, z)."""

from dataclasses import dataclass

from solver.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Imu:
    """Mean specific force and turn rate over one step, in the body frame."""

    force: FloatArray
    """Shape (3,), m/s^2: at rest it points up."""

    rate: FloatArray
    """Shape (3,), rad/s."""


@dataclass(frozen=True, slots=True)
class Odometry:
    """A pose in the odometry's own frame, which is level but starts anywhere and drifts."""

    position: FloatArray
    """Shape (3,)."""

    attitude: FloatArray
    """Shape (4,)."""


@dataclass(frozen=True, slots=True)
class TagSighting:
    """A tag as seen: where it is from the body."""

    tag_id: int
    offset: FloatArray
    """Shape (3,), body frame."""

    covariance: FloatArray
    """Of the offset, shape (3, 3)."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the robot is, in the common frame."""

    position: FloatArray
    velocity: FloatArray
    attitude: FloatArray
    covariance: FloatArray
    """Of the position, shape (3, 3)."""

    blind_s: float
    """Since the last odometry or tag that was believed."""


@dataclass(frozen=True, slots=True)
class Stance:
    """Where a robot is and how it is turned, in the common frame: what its camera looks from."""

    position: FloatArray
    """Shape (3,)."""

    attitude: FloatArray
    """Shape (4,)."""

    attitude_variance: float
    """Of each of its angles, rad^2."""
