"""Which pairs are looked at, against all of them."""

import numpy as np
import pytest

from solver.pairs import near_pairs


@pytest.mark.parametrize("count", [0, 1, 2, 5, 64])
def test_small_teams_get_all_their_pairs_in_order(count: int) -> None:
    first, second = near_pairs(np.zeros((count, 2)), 0.0)
    expected = [(i, k) for i in range(count) for k in range(i + 1, count)]
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == expected
    assert not first.flags.writeable
    assert not second.flags.writeable


@pytest.mark.parametrize("reach", [0.0, 0.5, 2.0])
def test_large_teams_get_the_near_ones_in_order(reach: float) -> None:
    positions = np.random.default_rng(0).uniform(0.0, 5.0, size=(65, 2))
    first, second = near_pairs(positions, reach)
    expected = [
        (i, k)
        for i in range(65)
        for k in range(i + 1, 65)
        if np.hypot(*(positions[i] - positions[k])) <= reach
    ]
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == expected
