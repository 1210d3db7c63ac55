"""Plans shifted in time."""

import numpy as np
import pytest

from solver.plans import shifted

PLAN = np.arange(8.0).reshape(1, 4, 2)


@pytest.mark.parametrize(
    ("elapsed_s", "rows"),
    [
        (0.0, [0, 1, 2, 3]),
        (0.3, [0, 1, 2, 3]),
        (0.5, [1, 2, 3, 3]),
        (1.2, [2, 3, 3, 3]),
        (99.0, [3, 3, 3, 3]),
        (-1.0, [0, 1, 2, 3]),
    ],
)
def test_what_is_still_to_come(elapsed_s: float, rows: list[int]) -> None:
    assert np.array_equal(shifted(PLAN, elapsed_s, 0.5), PLAN[:, rows])
