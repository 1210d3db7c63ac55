"""Hit probabilities and jamming against independent formulas."""

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from solver.zones import ZoneKind
from tests.vehicles.world.worlds import zone
from vehicles.world.attacks import densities, hit_probabilities, jammed, spreads
from vehicles.world.setup import JammingLaw

POSITIONS = np.array([[0.0, 0.0], [1.0, -0.5], [4.0, 3.0]])


def test_densities_are_those_of_the_normal_distribution() -> None:
    covariance = ((0.8, 0.3), (0.3, 0.5))
    zones = (
        zone("s1", ZoneKind.SENSING, (0.5, 0.5), covariance).zone,
        zone("c1", ZoneKind.COMMUNICATION, (4.0, 3.0)).zone,
    )
    expected = [
        [multivariate_normal((0.5, 0.5), covariance).pdf(p), multivariate_normal((4.0, 3.0)).pdf(p)]
        for p in POSITIONS
    ]
    np.testing.assert_allclose(densities(zones, POSITIONS), expected, rtol=1e-12)
    assert densities((), POSITIONS).shape == (3, 0)


def test_a_density_above_one_hits_with_certainty_and_no_more() -> None:
    chances = hit_probabilities(np.array([[0.0, 0.3, 1.5, 80.0]]), 0.25, 0.5)
    np.testing.assert_allclose(chances, [[0.0, 0.15, 0.75, 1.0]])


def test_spread_is_the_way_to_the_farthest_robot() -> None:
    np.testing.assert_allclose(
        spreads(POSITIONS, JammingLaw.LINEAR), [5.0, math.hypot(3.0, 3.5), 5.0]
    )
    assert spreads(POSITIONS[:1], JammingLaw.LINEAR) == pytest.approx([0.0])
    assert spreads(np.zeros((0, 2)), JammingLaw.LINEAR).shape == (0,)


def test_jamming_reaches_delta_times_the_spread() -> None:
    zones = (zone("c1", ZoneKind.COMMUNICATION, margin=0.25).zone,)
    pair = np.array([[1.0, 0.0], [5.0, 0.0]])
    assert not jammed(zones, pair, JammingLaw.LINEAR).any()  # 1.0 is not below 0.25 * 4.0
    pair[1, 0] = 5.01
    assert jammed(zones, pair, JammingLaw.LINEAR).tolist() == [[True], [False]]


def test_a_robot_alone_is_not_jammed_by_spread() -> None:
    zones = (zone("c1", ZoneKind.COMMUNICATION, margin=5.0).zone,)
    assert not jammed(zones, np.zeros((1, 2)), JammingLaw.LINEAR).any()


@pytest.mark.parametrize("distance", [0.0, 0.1, 0.35, 0.39, 0.4, 0.41, 0.6])
def test_the_authors_law_is_their_formula(distance: float) -> None:
    delta, mate = 0.2, 4.0
    robots = np.array([[distance, 0.0], [distance, mate]])
    farthest = max(abs(d) + 1e-4 for d in (0.0, mate))
    expected = distance + 1e-4 < delta * math.sqrt(max(1e-4, farthest))
    zones = (zone("c1", ZoneKind.COMMUNICATION, margin=delta).zone,)
    assert bool(jammed(zones, robots, JammingLaw.AUTHORS)[0, 0]) is expected


def test_sensing_zones_do_not_jam() -> None:
    zones = (zone("s1", ZoneKind.SENSING, margin=5.0).zone,)
    assert not jammed(zones, POSITIONS, JammingLaw.LINEAR).any()
