"""The measurement model."""

import math

import pytest

from solver.problem import SensorModel
from vehicles.world.sensing import deviations, measure
from vehicles.world.setup import NoiseLaw

MODEL = SensorModel(range_peak=15.0, range_shape=0.2, bearing_peak=10.0, bearing_shape=0.1)


def test_the_sound_law_takes_r_as_variance() -> None:
    range_deviation, bearing_deviation = deviations(MODEL, NoiseLaw.SOUND, 3.0)
    assert range_deviation**2 == pytest.approx(1.0 / (15.0 * math.exp(-0.6)))
    assert bearing_deviation**2 == pytest.approx(1.0 / (10.0 * math.exp(-0.3)))


def test_the_authors_law_takes_r_as_deviation() -> None:
    distance = math.sqrt(9.0 + 1e-4)
    expected = (
        1.0 / (15.0 * math.exp(-0.2 * distance) + 1e-4),
        1.0 / (10.0 * math.exp(-0.1 * distance) + 1e-4),
    )
    assert deviations(MODEL, NoiseLaw.AUTHORS, 3.0) == pytest.approx(expected)


@pytest.mark.parametrize("law", NoiseLaw)
def test_far_away_the_numbers_stay_finite(law: NoiseLaw) -> None:
    assert all(math.isfinite(value) for value in deviations(MODEL, law, 1e6))


def test_without_noise_a_sighting_is_the_true_geometry() -> None:
    sighting = measure(MODEL, NoiseLaw.SOUND, (1.0, 1.0), (122, (-2.0, 5.0)), (0.0, 0.0))
    assert sighting.target_id == 122
    assert sighting.range_m == pytest.approx(5.0)
    assert sighting.bearing_rad == pytest.approx(math.atan2(4.0, -3.0))


def test_noise_scales_with_the_deviation_and_the_bearing_is_wrapped() -> None:
    range_deviation, bearing_deviation = deviations(MODEL, NoiseLaw.SOUND, 2.0)
    sighting = measure(MODEL, NoiseLaw.SOUND, (0.0, 0.0), (1, (-2.0, 1e-9)), (-2.0, 1.0))
    assert sighting.range_m == pytest.approx(2.0 - 2.0 * range_deviation)
    assert sighting.bearing_rad == pytest.approx(-math.pi + bearing_deviation)
