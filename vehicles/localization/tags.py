"""Tags in camera frames: where they are, and how sure that is.

A tag's pose is fitted to its four corners in the picture. The corners are uncertain by some part
of a pixel, and that is carried through the projection to the pose: the covariance grows with the
square of the distance along the line of sight, as it does in truth.

The detector is pupil-apriltags, of the extra `tags`; it is imported when a detector is made.
Cameras look along z, with x to the right and y down, and are free of distortion.
"""

import importlib
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from solver.arrays import FloatArray
from solver.observations import Sighting
from vehicles.localization import rotations
from vehicles.localization.measurements import TagSighting

Picture = npt.NDArray[np.uint8]
"""Grey values, shape (height, width)."""

FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Turns a camera that looks forward into the body: x forward, y left, z up."""

_NUDGE = 1e-6
_CORNERS = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 0.0]])
"""Of a tag of size 1, in the detector's order: lower left, then against the clock."""


class DetectorMissingError(ImportError):
    """Raised when the tag detector is not installed."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera and where it sits on the body.

    Raises:
        ValueError: A focal length or the corner noise is not above 0.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    """Pixels."""

    turn: FloatArray = field(default_factory=FORWARD.copy)
    """From camera to body, shape (3, 3)."""

    place: FloatArray = field(default_factory=lambda: np.zeros(3))
    """On the body, shape (3,), metres."""

    corner_px: float = 0.3
    """Standard deviation of a corner's place in the picture, per axis."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (self.fx > 0.0 and self.fy > 0.0 and self.corner_px > 0.0):
            raise ValueError("focal lengths and corner noise must be above 0")

    def projected(self, points: FloatArray) -> FloatArray:
        """Return the pixels (n, 2) of points (n, 3) in front of the camera."""
        x, y, z = points[:, 0], points[:, 1], points[:, 2]
        return np.stack((self.fx * x / z + self.cx, self.fy * y / z + self.cy), axis=1)


class TagDetector(Protocol):
    """Finds tags in pictures."""

    def detect(self, picture: Picture) -> tuple[TagSighting, ...]:
        """Return the tags seen, from the body."""
        ...


class AprilTagDetector:
    """Finds AprilTags with pupil-apriltags.

    Args:
        camera: That took the pictures.
        size_m: Edge of the black border of the tags.
        family: Of the tags.
        least_margin: Decision margin below which a detection is no tag.

    Raises:
        DetectorMissingError: pupil-apriltags is not installed.
    """

    def __init__(
        self,
        camera: Camera,
        size_m: float,
        family: str = "tag36h11",
        least_margin: float = 30.0,
    ) -> None:
        self._camera = camera
        self._size_m = size_m
        self._least_margin = least_margin
        self._detector = _library().Detector(families=family, quad_decimate=1.0)

    def detect(self, picture: Picture) -> tuple[TagSighting, ...]:
        """Return the tags seen, from the body; corrected bits are not accepted."""
        camera = self._camera
        found = self._detector.detect(
            picture,
            estimate_tag_pose=True,
            camera_params=(camera.fx, camera.fy, camera.cx, camera.cy),
            tag_size=self._size_m,
        )
        return tuple(
            sighting_of(camera, self._size_m, one.tag_id, one.pose_R, one.pose_t[:, 0])
            for one in found
            if one.hamming == 0 and one.decision_margin >= self._least_margin
        )


def _library() -> Any:
    try:
        return importlib.import_module("pupil_apriltags")
    except ImportError as error:
        raise DetectorMissingError(
            "finding tags in pictures needs pupil-apriltags: install falconer with the extra tags"
        ) from error


def sighting_of(
    camera: Camera, size_m: float, tag_id: int, turn: FloatArray, place: FloatArray
) -> TagSighting:
    """Return a tag's pose in the camera as a sighting from the body.

    Args:
        camera: That saw it.
        size_m: Edge of its black border.
        tag_id: Its number.
        turn: From tag to camera, shape (3, 3).
        place: In the camera, shape (3,).
    """
    covariance = camera.turn @ place_covariance(camera, size_m, turn, place) @ camera.turn.T
    offset = camera.turn @ place + camera.place
    return TagSighting(tag_id, offset, 0.5 * (covariance + covariance.T))


def place_covariance(
    camera: Camera, size_m: float, turn: FloatArray, place: FloatArray
) -> FloatArray:
    """Return the covariance (3, 3) of a tag's place in the camera, m^2.

    Pose and corners are tied by the projection: with J its derivative by the six numbers of the
    pose, the covariance of the pose is (J'J)^-1 times the variance of a corner.
    """
    corners = size_m * _CORNERS

    def pixels(change: FloatArray) -> FloatArray:
        tilted = rotations.turned(rotations.of_vector(change[3:]), corners)
        return camera.projected(tilted @ turn.T + place + change[:3]).ravel()

    steps = _NUDGE * np.eye(6)
    columns = [(pixels(step) - pixels(-step)) / (2.0 * _NUDGE) for step in steps]
    jacobian = np.stack(columns, axis=1)
    information = jacobian.T @ jacobian / camera.corner_px**2
    pose = np.linalg.pinv(information, hermitian=True)
    return np.asarray(pose[:3, :3], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class TargetSighting:
    """Range and bearing of a target that carries a tag, with their variances."""

    sighting: Sighting
    range_variance: float
    """m^2."""

    bearing_variance: float
    """rad^2."""


def target_sightings(
    seen: Iterable[TagSighting],
    attitude: FloatArray,
    attitude_variance: float,
    targets: dict[int, int],
) -> tuple[TargetSighting, ...]:
    """Return what tags carried by targets tell of them, in the plane.

    Args:
        seen: From the body.
        attitude: Of the body in the common frame, shape (4,).
        attitude_variance: Of each of its angles, rad^2.
        targets: Target by tag.

    Returns:
        One for each tag of a target that is not exactly above or below the robot.
    """
    result = []
    for one in seen:
        target = targets.get(one.tag_id)
        turn = rotations.matrix_of(attitude)
        east, north, up = (float(number) for number in turn @ one.offset)
        distance = math.hypot(east, north)
        if target is None or distance == 0.0:
            continue
        # An error of attitude swings the whole line of sight.
        swing = np.array([[0.0, up, -north], [-up, 0.0, east], [north, -east, 0.0]])
        covariance = turn @ one.covariance @ turn.T + attitude_variance * swing @ swing.T
        along = np.array([east, north, 0.0]) / distance
        across = np.array([-north, east, 0.0]) / distance**2
        result.append(
            TargetSighting(
                Sighting(target, distance, math.atan2(north, east)),
                float(along @ covariance @ along),
                float(across @ covariance @ across),
            )
        )
    return tuple(result)
