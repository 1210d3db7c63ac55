"""Prices of exposure against the density and a filter written out by hand."""

from itertools import pairwise

import numpy as np
import pytest

from solver.beliefs import FilterSettings, MotionModel
from solver.exposure import RIMS, sight_loss, zone_table
from solver.problem import SensorModel
from solver.zones import Zone, ZoneKind

ROUND = Zone("s1", ZoneKind.SENSING, (1.0, 2.0), ((0.4, 0.0), (0.0, 0.4)), 0.1, 0.1)
LONG = Zone("s2", ZoneKind.SENSING, (-3.0, 0.0), ((0.9, 0.2), (0.2, 0.3)), 0.2, 0.05)
KNOWN = np.array([[True, False], [True, True], [False, False]])
SENSOR = SensorModel()
WALK = FilterSettings(process_noise=0.1)


def priced(zone: Zone, price: float, points: np.ndarray, severity: float = 1.0) -> np.ndarray:
    """Return what the rims' rows cost at points (E, 2), without the zone's own rim."""
    table = zone_table([zone], np.ones((1, 1), dtype=bool), [0.0], [0.0], [severity], price)
    offsets = np.asarray(zone.mean) - points
    distance = np.linalg.norm(offsets, axis=1)
    n = offsets / distance[:, None]
    total = np.zeros(len(points))
    for row in range(1, len(table.margins)):
        deviation = np.sqrt(np.einsum("ei,ij,ej->e", n, table.covariances[row], n))
        short = np.maximum(0.0, table.quantiles[row] * deviation + table.margins[row] - distance)
        total += table.severities[row] * short**2
    return total


def around(zone: Zone, deviations: float) -> np.ndarray:
    """Return points (12, 2) at a Mahalanobis distance."""
    angle = np.linspace(0.1, 2.0 * np.pi, 12)
    circle = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    return np.asarray(zone.mean) + deviations * circle @ np.linalg.cholesky(zone.covariance).T


@pytest.mark.parametrize("deviations", [1.0, 1.5, 2.0, 2.5])
def test_the_rims_of_a_round_zone_cost_its_density_times_the_price(deviations: float) -> None:
    points = around(ROUND, deviations)
    assert priced(ROUND, 3.0, points) == pytest.approx(3.0 * ROUND.density(points), rel=0.15)
    assert priced(ROUND, 3.0, points, 2.0) == pytest.approx(2.0 * priced(ROUND, 3.0, points))


def test_exposure_falls_all_the_way_from_the_centre_and_ends() -> None:
    paid = [float(priced(LONG, 1.0, around(LONG, m)).max()) for m in np.arange(0.05, 4.0, 0.05)]
    assert all(later <= earlier for earlier, later in pairwise(paid))
    assert paid[0] - paid[5] > 0.1 * paid[0], "a robot in the middle is drawn out"
    far = np.asarray(LONG.mean) + np.array([[4.0, 0.0], [0.0, -4.0]])
    assert priced(LONG, 1.0, far).tolist() == [0.0, 0.0]


def test_a_zone_keeps_its_own_rim_and_its_rims_are_known_to_the_same_robots() -> None:
    table = zone_table([ROUND, LONG], KNOWN, [1.3, 1.6], [0.1, 0.2], [1.0, 2.0], 5.0)
    assert table.centres[:2].tolist() == [[1.0, 2.0], [-3.0, 0.0]]
    assert table.quantiles[:2].tolist() == [1.3, 1.6]
    assert table.margins.tolist() == [0.1, 0.2] + [0.0] * (2 * len(RIMS))
    assert table.severities[:2].tolist() == [1.0, 2.0]
    assert table.known.shape == (3, 2 * (1 + len(RIMS)))
    for copy in range(1 + len(RIMS)):
        assert np.array_equal(table.known[:, 2 * copy : 2 * copy + 2], KNOWN)
        assert np.array_equal(table.centres[2 * copy : 2 * copy + 2], table.centres[:2])


@pytest.mark.parametrize("price", [0.0, -1.0, np.nan, np.inf])
def test_without_a_price_there_is_the_rim_alone(price: float) -> None:
    table = zone_table([ROUND, LONG], KNOWN, [1.3, 1.6], [0.1, 0.2], [1.0, 2.0], price)
    assert table.quantiles.tolist() == [1.3, 1.6]
    assert np.array_equal(table.known, KNOWN)


def test_no_zones_make_an_empty_table_for_any_team() -> None:
    table = zone_table([], np.zeros((3, 0), dtype=bool), [], [], [], 2.0)
    assert table.known.shape == (3, 0)
    assert table.covariances.shape == (0, 2, 2)


def test_losing_the_only_watcher_costs_what_the_walk_adds() -> None:
    # Nobody measures: after k ticks of 0.5 s the trace is 2 * 0.1 * 0.5 k above where it was.
    assert sight_loss(1, WALK, SENSOR, 0.5, 2.0) == pytest.approx(0.5 * 0.1 * (1 + 2 + 3 + 4))
    assert sight_loss(1, WALK, SENSOR, 0.5, 1.25) == pytest.approx(
        0.1 * (0.5 * 1 + 0.5 * 2 + 0.25 * 3)
    )


def test_a_second_watcher_makes_a_failure_cheap() -> None:
    alone, backed = (sight_loss(count, WALK, SENSOR, 0.5, 2.0) for count in (1, 2))
    assert 0.0 < backed < 0.2 * alone
    assert sight_loss(1, WALK, SENSOR, 0.5, 0.0) == 0.0


def test_at_constant_velocity_the_loss_is_that_of_the_filter_written_out() -> None:
    settings = FilterSettings(model=MotionModel.CONSTANT_VELOCITY, process_noise=0.2)
    F = np.array([[1.0, 0.1], [0.0, 1.0]])
    Q = 0.2 * np.array([[1e-3 / 3.0, 5e-3], [5e-3, 0.1]])
    # Range and bearing tell the same from one metre.
    H, R = np.array([[1.0, 0.0]]), np.array([[1.0 / (15.0 * np.exp(-0.2))]])
    P = 10.0 * np.eye(2)
    for _ in range(3000):
        P = F @ P @ F.T + Q
        P = P - P @ H.T @ np.linalg.inv(H @ P @ H.T + R) @ H @ P
    settled, loss = P[0, 0], 0.0
    for _ in range(15):
        P = F @ P @ F.T + Q
        loss += 0.1 * 2.0 * (P[0, 0] - settled)
    assert sight_loss(1, settings, SENSOR, 0.1, 1.5) == pytest.approx(loss, rel=1e-6)
