"""Tag detection on rendered pictures of real markers, and the honesty of its noise."""

import importlib
import math
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from benchmarks.odometry import quaternion
from tests.vehicles.localization.pictures import Placed, marker, picture
from vehicles.localization.measurements import TagSighting
from vehicles.localization.tags import (
    AprilTagDetector,
    Camera,
    DetectorMissingError,
    place_covariance,
    target_sightings,
)

CAMERA = Camera(400.0, 400.0, 240.0, 180.0, corner_px=0.05)
"""Drawn corners are ten times as sharp as those of a real lens, and so is what is claimed here."""

SIZE_M = 0.16


def placed(tag_id: int, x: float, y: float, z: float, *angles: float) -> Placed:
    """Return a tag at a place of the camera, turned by angles about x, y, z."""
    return Placed(tag_id, SIZE_M, np.array([x, y, z]), Rotation.from_euler("xyz", angles))


def test_markers_differ_and_have_a_black_border() -> None:
    one, other = marker(0), marker(1)
    assert one.shape == (10, 10)
    assert (one[1, 1:-1] == 0).all()
    assert (one[0] == 1).all()
    assert (one != other).sum() >= 11


def test_tags_are_found_where_they_are() -> None:
    there = [
        placed(5, 0.3, -0.1, 1.5, 0.3, -0.4, 0.2),
        placed(17, -0.4, 0.2, 2.0, -0.2, 0.5, 1.0),
        placed(586, 0.0, 0.1, 1.0, 0.1, 0.1, -2.0),
    ]
    seen = AprilTagDetector(CAMERA, SIZE_M).detect(picture(CAMERA, there, np.random.default_rng(1)))
    assert sorted(one.tag_id for one in seen) == [5, 17, 586]
    for tag in there:
        one = next(s for s in seen if s.tag_id == tag.tag_id)
        x, y, z = tag.place
        # The camera looks forward: its z is the body's x, its x the body's right.
        assert one.offset == pytest.approx([z, -x, -y], abs=0.03)


def test_the_noise_is_honest() -> None:
    """Errors of many renderings fit their covariances: neither boast nor false modesty."""
    dice = np.random.default_rng(2)
    detector = AprilTagDetector(CAMERA, SIZE_M)
    nees = []
    for number in range(12):
        z = dice.uniform(0.8, 2.5)
        x, y = dice.uniform(-0.3, 0.3) * z, dice.uniform(-0.25, 0.25) * z
        tilt = dice.choice([-1, 1]) * dice.uniform(0.35, 0.8)
        tag = placed(number, x, y, z, tilt, dice.uniform(-0.3, 0.3), dice.uniform(-3, 3))
        seen = detector.detect(picture(CAMERA, [tag], dice))
        assert [one.tag_id for one in seen] == [number]
        error = seen[0].offset - [z, -x, -y]
        nees.append(error @ np.linalg.solve(seen[0].covariance, error))
    assert np.mean(np.array(nees) < chi2.ppf(0.99, 3)) > 0.8
    assert 0.3 < np.mean(nees) < 6.0


def test_an_empty_wall_shows_no_tag() -> None:
    assert (
        AprilTagDetector(CAMERA, SIZE_M).detect(picture(CAMERA, [], np.random.default_rng(3))) == ()
    )


def test_distance_blurs() -> None:
    """The deviation along the line of sight grows about with the square of the distance."""
    turn = Rotation.from_euler("x", 0.5).as_matrix()
    near, far = (
        math.sqrt(place_covariance(CAMERA, SIZE_M, turn, np.array([0.0, 0.0, z]))[2, 2])
        for z in (1.0, 3.0)
    )
    assert 6.0 < far / near < 14.0


def test_covariance_against_chance() -> None:
    """The covariance against a Monte Carlo of noisy corners, each fitted by least squares."""
    from scipy.optimize import least_squares

    from vehicles.localization.tags import _CORNERS

    dice, place = np.random.default_rng(4), np.array([0.1, -0.05, 1.2])
    turn = Rotation.from_euler("xyz", [0.5, 0.2, 0.3])
    corners = SIZE_M * _CORNERS

    def pixels(p: Any) -> Any:
        local = (turn * Rotation.from_rotvec(p[3:])).apply(corners) + p[:3]
        return CAMERA.projected(local).ravel()

    start = np.array([*place, 0.0, 0.0, 0.0])
    true = pixels(start)
    fitted = []
    for _ in range(150):
        noisy = true + dice.normal(0.0, CAMERA.corner_px, 8)
        fitted.append(least_squares(lambda p, z=noisy: pixels(p) - z, start).x[:3])
    expected = np.cov(np.array(fitted).T)
    ours = place_covariance(CAMERA, SIZE_M, turn.as_matrix(), place)
    assert np.sqrt(np.diag(ours)) == pytest.approx(np.sqrt(np.diag(expected)), rel=0.2)


def test_targets_become_ranges_and_bearings() -> None:
    """Mean and variances against chance, the robot tilted and the target above it."""
    attitude = Rotation.from_euler("ZYX", [0.8, 0.1, -0.2])
    offset, covariance = np.array([3.0, 1.0, 0.8]), np.diag([0.02, 0.01, 0.005])
    (found,) = target_sightings(
        [TagSighting(9, offset, covariance), TagSighting(10, offset, covariance)],
        quaternion(attitude),
        0.0004,
        {9: 122},
    )
    dice = np.random.default_rng(5)
    errors = dice.normal(0.0, math.sqrt(0.0004), (20_000, 3))
    noisy = dice.multivariate_normal(offset, covariance, 20_000)
    vectors = Rotation.from_rotvec(errors).apply(attitude.apply(noisy))
    ranges = np.hypot(vectors[:, 0], vectors[:, 1])
    bearings = np.arctan2(vectors[:, 1], vectors[:, 0])
    assert found.sighting.target_id == 122
    assert found.sighting.range_m == pytest.approx(ranges.mean(), abs=0.01)
    assert found.sighting.bearing_rad == pytest.approx(bearings.mean(), abs=0.005)
    assert found.range_variance == pytest.approx(ranges.var(), rel=0.05)
    assert found.bearing_variance == pytest.approx(bearings.var(), rel=0.05)


def test_a_missing_library_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str, package: str | None = None) -> ModuleType:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(DetectorMissingError, match="extra tags"):
        AprilTagDetector(CAMERA, SIZE_M)


@pytest.mark.parametrize("numbers", [(0.0, 1.0), (1.0, -1.0)])
def test_a_camera_has_focal_lengths(numbers: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="above 0"):
        Camera(*numbers, 320.0, 240.0)
