"""The smallest distance of a team against all pairs."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vehicles.world.spacing import closest_m


@given(arrays(np.float64, st.tuples(st.integers(2, 12), st.just(2)), elements=st.integers(-9, 9)))
def test_it_is_the_least_of_all_pairs(positions: np.ndarray) -> None:
    pairs = combinations(positions.tolist(), 2)
    assert closest_m(positions) == pytest.approx(min(math.dist(a, b) for a, b in pairs))


def test_a_crowd_in_a_column_is_looked_through_too() -> None:
    column = np.array([[0.0, 3.0 * k] for k in range(50)])
    column[20, 1] += 2.5
    assert closest_m(column) == pytest.approx(0.5)


@pytest.mark.parametrize("count", [0, 1])
def test_nobody_is_near_a_robot_that_is_alone(count: int) -> None:
    assert math.isinf(closest_m(np.zeros((count, 2))))
