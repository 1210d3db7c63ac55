"""A zone's numbers, against SciPy's distributions."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from solver.zones import Zone, ZoneKind

ZONE = Zone("s1", ZoneKind.SENSING, (1.0, -2.0), ((0.9, 0.3), (0.3, 0.4)), 0.2, 0.05, 0.2)


def test_the_quantile_is_that_of_the_normal_distribution_at_the_tolerated_risk() -> None:
    assert ZONE.quantile() == pytest.approx(norm.ppf(0.95))
    assert ZONE.quantile_single() == pytest.approx(norm.ppf(0.8))
    assert ZONE.quantile(4.0) == pytest.approx(2.0 * norm.ppf(0.95))
    assert ZONE.quantile_single(4.0) == pytest.approx(2.0 * norm.ppf(0.8))


def test_who_plans_alone_accepts_a_risk_of_a_tenth_where_nothing_is_said() -> None:
    plain = Zone("s1", ZoneKind.SENSING, (0.0, 0.0), ((1.0, 0.0), (0.0, 1.0)), 0.2, 0.05)
    assert plain.quantile_single() == pytest.approx(norm.ppf(0.9))


def test_density_at_one_point_and_at_a_grid_of_them() -> None:
    reference = multivariate_normal(ZONE.mean, np.array(ZONE.covariance))
    grid = np.random.default_rng(0).normal(size=(3, 4, 2)) + ZONE.mean
    np.testing.assert_allclose(ZONE.density(grid), reference.pdf(grid))
    assert ZONE.density(grid[1, 2]) == pytest.approx(reference.pdf(grid[1, 2]))
