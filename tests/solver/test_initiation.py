"""A track's first place and its covariance, against the noise drawn a million times."""

from dataclasses import replace

import numpy as np
import pytest

from solver import estimation
from solver.beliefs import FilterSettings, MotionModel
from solver.observations import Detections, Sighting
from solver.problem import SensorModel
from tests.solver.measuring import noise_variances

SENSOR = SensorModel(range_peak=40.0, range_shape=0.1, bearing_peak=12.0, bearing_shape=0.1)
WALK = FilterSettings()
CRUISE = FilterSettings(model=MotionModel.CONSTANT_VELOCITY, speed_variance=0.4)
ROBOT = (2.0, -1.0)


def born(settings: FilterSettings, *sightings: Sighting) -> estimation.Beliefs:
    unknown = estimation.predict(estimation.start((7, 9), settings), settings, 3.0)
    unknown = replace(unknown, rejected=np.array([4, 4]))
    return estimation.update(unknown, settings, SENSOR, (Detections(1, ROBOT, sightings),))


@pytest.mark.parametrize("settings", [WALK, CRUISE], ids=["walk", "cruise"])
@pytest.mark.parametrize(("distance", "bearing"), [(5.0, 0.7), (1.5, -2.4), (9.0, 3.0)])
def test_a_track_starts_where_the_noise_would_have_put_it_on_the_average(
    distance: float, bearing: float, settings: FilterSettings
) -> None:
    dice = np.random.default_rng(0)
    w, v = noise_variances(SENSOR, distance)
    ranges = distance + np.sqrt(w) * dice.standard_normal(1_000_000)
    angles = bearing + np.sqrt(v) * dice.standard_normal(1_000_000)
    places = ranges * np.stack((np.cos(angles), np.sin(angles)))
    found = born(settings, Sighting(9, distance, bearing))
    spread = np.cov(places)
    scale = float(np.sqrt(np.trace(spread)))
    mean = np.asarray(ROBOT) + places.mean(axis=1)
    np.testing.assert_allclose(found.means[1, :2], mean, atol=0.005 * scale)
    np.testing.assert_allclose(found.covariances[1, :2, :2], spread, atol=0.01 * scale**2)
    np.testing.assert_array_equal(found.means[1, 2:], 0.0)
    if settings is CRUISE:
        np.testing.assert_allclose(found.covariances[1, 2:, 2:], 0.4 * np.eye(2))
        np.testing.assert_array_equal(found.covariances[1, :2, 2:], 0.0)
    assert found.known.tolist() == found.started.tolist() == [False, True]
    assert found.unseen_s.tolist() == [3.0, 0.0]
    assert found.rejected.tolist() == [4, 0]
    np.testing.assert_array_equal(found.covariances[0, :2, :2], 100.0 * np.eye(2))


def test_the_most_precise_sighting_starts_a_track_and_the_others_refine_it() -> None:
    near, far = Sighting(9, 2.0, 0.3), Sighting(9, 14.0, 0.3)
    alone = born(WALK, near)
    for order in ((near, far), (far, near)):
        both = born(WALK, *order)
        refined = estimation.update(alone, WALK, SENSOR, (Detections(1, ROBOT, (far,)),))
        np.testing.assert_allclose(both.means[1], refined.means[1])
        np.testing.assert_allclose(both.covariances[1], refined.covariances[1])


def test_a_range_below_zero_is_none() -> None:
    found = born(WALK, Sighting(9, -0.2, 0.3))
    np.testing.assert_allclose(found.means[1], ROBOT)
    assert np.linalg.eigvalsh(found.covariances[1])[0] > 0.0
