"""Registration of frames from sightings, a fifth of them wrong."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from benchmarks.localization import (
    SIGHTINGS,
    WRONG,
    registration_error,
    registrations,
    sightings,
)
from benchmarks.odometry import TAGS, quaternion
from vehicles.localization.measurements import Odometry, TagSighting
from vehicles.localization.registration import (
    Landmark,
    RegistrationError,
    landmark,
    register,
)


def test_below_five_centimetres_and_two_degrees() -> None:
    """Twenty sightings with 5 cm of noise per axis, four of them wrong, fifty times."""
    off_m, turn_rad = registrations(50, seed=3).T
    assert off_m.max() < 0.05
    assert turn_rad.max() < math.radians(2.0)


def test_wrong_sightings_are_named() -> None:
    dice = np.random.default_rng(3)
    for _ in range(50):
        found = register(sightings(dice, np.full(SIGHTINGS, 0.05), WRONG))
        assert found.agreeing[:WRONG] == (False,) * WRONG


def test_the_covariance_is_honest() -> None:
    """NEES over 100 registrations lies within its bounds."""
    dice = np.random.default_rng(5)
    noise_m = dice.uniform(0.02, 0.2, SIGHTINGS)
    nees = []
    for _ in range(100):
        found = register(sightings(dice, noise_m, 0))
        e = registration_error(found)
        nees.append(e @ np.linalg.solve(found.covariance, e))
    low, high = chi2.ppf([0.001, 0.999], 100 * 4) / 100
    # Good sightings that are left out by chance (1 %) make it slightly too sure.
    assert low < np.mean(nees) < 1.05 * high


def test_better_sightings_weigh_more() -> None:
    dice = np.random.default_rng(6)
    even = np.full(SIGHTINGS, 0.3)
    mixed = even.copy()
    mixed[::2] = 0.01
    plain, weighed = [], []
    for _ in range(15):
        plain.append(np.linalg.norm(registration_error(register(sightings(dice, even, 0)))[:3]))
        weighed.append(np.linalg.norm(registration_error(register(sightings(dice, mixed, 0)))[:3]))
    assert np.mean(weighed) < 0.1 * np.mean(plain)


def test_it_agrees_with_kabsch_where_all_weigh_the_same() -> None:
    dice = np.random.default_rng(7)
    seen = sightings(dice, np.full(SIGHTINGS, 0.05), 0)
    found = register(seen)
    kept = [mark for mark, agrees in zip(seen, found.agreeing, strict=True) if agrees]
    flat_common = np.array([[*mark.common[:2], 0.0] for mark in kept])
    flat_seen = np.array([[*mark.odometry[:2], 0.0] for mark in kept])
    best, _ = Rotation.align_vectors(
        flat_common - flat_common.mean(axis=0), flat_seen - flat_seen.mean(axis=0)
    )
    yaw = best.as_euler("ZYX")[0]
    assert found.alignment.yaw_rad == pytest.approx(yaw, abs=1e-9)


def test_a_sighting_from_the_body_becomes_a_landmark() -> None:
    attitude = Rotation.from_euler("ZYX", [1.0, 0.2, -0.1])
    odometry = Odometry(np.array([1.0, 2.0, 3.0]), quaternion(attitude))
    covariance = np.diag([0.01, 0.04, 0.09])
    offset = np.array([2.0, 0.5, -0.3])
    mark = landmark(TagSighting(3, offset, covariance), odometry, 0.0025, {3: (7.0, 8.0, 9.0)})
    assert mark is not None
    assert mark.odometry == pytest.approx(odometry.position + attitude.apply(offset))
    turn = attitude.as_matrix()
    assert mark.covariance == pytest.approx(turn @ covariance @ turn.T + 0.0025 * np.eye(3))
    assert landmark(TagSighting(4, offset, covariance), odometry, 0.0, {3: (7.0, 8.0, 9.0)}) is None


def test_what_cannot_be_told_is_refused() -> None:
    dice = np.random.default_rng(8)
    seen = sightings(dice, np.full(SIGHTINGS, 0.05), 0)
    with pytest.raises(RegistrationError, match="too few"):
        register(seen[:2])
    with pytest.raises(RegistrationError, match="close together"):
        register(seen[:: len(TAGS)])
    chance = [Landmark(mark.common, dice.normal(0, 9, 3), mark.covariance) for mark in seen]
    with pytest.raises(RegistrationError, match="agree"):
        register(chance)
