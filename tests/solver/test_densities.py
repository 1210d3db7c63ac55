"""Densities against SciPy, reach and groups by hand."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from solver.densities import FARTHEST_M, NEAREST_M, density, gaussian, halves, reach_m

CENTRE, COVARIANCE = np.array([1.0, -2.0]), np.array([[0.9, 0.3], [0.3, 0.4]])
POINTS = np.random.default_rng(0).normal(size=(7, 2)) + CENTRE


def test_a_gaussian_is_scipys() -> None:
    expected = multivariate_normal(CENTRE, COVARIANCE).pdf(POINTS)
    np.testing.assert_allclose(gaussian(POINTS, CENTRE, COVARIANCE), expected)


def test_densities_add_up_by_their_masses() -> None:
    other = np.array([[0.2, 0.0], [0.0, 0.5]])
    shapes = [(CENTRE, COVARIANCE, 0.7), (np.zeros(2), other, 2.0)]
    expected = 0.7 * multivariate_normal(CENTRE, COVARIANCE).pdf(POINTS)
    expected += 2.0 * multivariate_normal(np.zeros(2), other).pdf(POINTS)
    np.testing.assert_allclose(density(shapes, POINTS), expected)
    np.testing.assert_array_equal(density([], POINTS), np.zeros(7))


@pytest.mark.parametrize(
    ("variances", "reach"),
    [((1.0, 1.0), 3.5), ((1.5, 0.5), 3.5), ((0.1, 0.1), NEAREST_M), ((9.0, 9.0), FARTHEST_M)],
)
def test_evidence_reaches_three_and_a_half_deviations_within_limits(
    variances: tuple[float, float], reach: float
) -> None:
    assert reach_m(np.diag(variances)) == pytest.approx(reach)


def test_points_fall_into_two_groups_along_their_long_axis() -> None:
    points = np.array([[-2.0, 0.1], [-1.0, -0.2], [2.0, 0.0], [3.0, 0.2]])
    weights = np.array([1.0, 3.0, 1.0, 1.0])
    groups = halves(points, weights)
    assert groups is not None
    west, east = sorted(groups, key=lambda place: float(place[0]))
    np.testing.assert_allclose(west, (points[0] + 3.0 * points[1]) / 4.0)
    np.testing.assert_allclose(east, (points[2] + points[3]) / 2.0)


@pytest.mark.parametrize(
    ("points", "weights"),
    [
        (np.zeros((0, 2)), np.zeros(0)),
        (np.array([[0.0, 0.0]]), np.array([9.0])),
        (np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([1.0, 2.4])),
        (np.array([[1.0, 1.0], [1.0, 1.0]]), np.array([4.0, 4.0])),
    ],
    ids=["none", "one", "too few hits", "all at one place"],
)
def test_too_few_points_are_no_two_groups(points: np.ndarray, weights: np.ndarray) -> None:
    assert halves(points, weights) is None


def test_just_enough_hits_may_be_two_zones() -> None:
    groups = halves(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([1.5, 2.0]))
    assert groups is not None
