"""The measurement model, against differentiated geometry."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.arrays import FloatArray
from solver.problem import SensorModel
from solver.sensing import TARGET_FLOOR_M, information, variances, wrapped
from tests.solver.measuring import noise_variances, predicted

coordinate = st.floats(-12.0, 12.0)
SENSOR = SensorModel(range_peak=15.0, range_shape=0.2, bearing_peak=9.0, bearing_shape=0.3)


@pytest.mark.parametrize("distance", [0.0, 0.1, 3.0, 60.0, 1e7])
def test_variances_grow_with_distance_as_the_law_says_and_stay_finite(distance: float) -> None:
    along, across = variances(SENSOR, np.full((2, 1), distance * distance))
    expected = noise_variances(SENSOR, distance)
    np.testing.assert_allclose(along, np.full((2, 1), expected[0]), rtol=1e-12)
    np.testing.assert_allclose(across, np.full((2, 1), expected[1]), rtol=1e-12)


@given(coordinate, coordinate)
def test_information_is_that_of_the_differentiated_measurement(x: float, y: float) -> None:
    # Rows by central differences of range and bearing to the target, noise at that distance.
    target = np.array([x, y])
    distance = float(np.hypot(x, y))
    if distance < 0.5:
        return
    step = 1e-6
    rows = np.empty((2, 2))
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        ahead = np.array(predicted((0.0, 0.0), (x + shift[0], y + shift[1])))
        behind = np.array(predicted((0.0, 0.0), (x - shift[0], y - shift[1])))
        difference = ahead - behind
        difference[1] = wrapped(difference[1:])[0]
        rows[:, axis] = difference / (2.0 * step)
    # The floor lengthens the distance in the model; scale the plain rows accordingly.
    rho = np.hypot(distance, TARGET_FLOOR_M)
    rows[0] *= distance / rho
    rows[1] *= (distance / rho) ** 2
    expected = rows.T @ np.diag(1.0 / np.array(noise_variances(SENSOR, distance))) @ rows
    np.testing.assert_allclose(information(SENSOR, -target), expected, rtol=1e-5, atol=1e-8)


@given(coordinate, coordinate)
def test_information_never_has_a_negative_eigenvalue(x: float, y: float) -> None:
    values = np.linalg.eigvalsh(information(SENSOR, np.array([x, y])))
    assert values[0] >= -1e-12 * max(values[1], 1.0)


def test_a_robot_exactly_above_learns_nothing_and_nothing_breaks() -> None:
    np.testing.assert_array_equal(information(SENSOR, np.zeros((3, 2))), np.zeros((3, 2, 2)))


def test_wrapped_brings_angles_into_one_turn() -> None:
    angles: FloatArray = np.array([0.0, 3.5, -3.5, 7.0, -9.0])
    turned = wrapped(angles)
    assert (turned >= -np.pi).all()
    assert (turned < np.pi).all()
    np.testing.assert_allclose(np.exp(1j * turned), np.exp(1j * angles), atol=1e-12)
