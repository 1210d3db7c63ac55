"""Plans shifted in time."""

import numpy as np
import pytest

from solver.plans import shifted

PLAN = np.arange(8.0).reshape(1, 4, 2)


@pytest.mark.parametrize(
    ("elapsed_s", "rows"),
    [
        (0.0, [0, 1, 2, 3]),
        (0.5, [1, 2, 3, 3]),
        (1.0, [2, 3, 3, 3]),
        (99.0, [3, 3, 3, 3]),
        (-1.0, [0, 1, 2, 3]),
    ],
)
def test_what_is_still_to_come(elapsed_s: float, rows: list[int]) -> None:
    assert np.array_equal(shifted(PLAN, elapsed_s, 0.5), PLAN[:, rows])


def test_between_steps_it_is_interpolated_and_the_last_goes_on() -> None:
    moved = shifted(PLAN, 0.1, 0.5)
    assert moved[0, :3] == pytest.approx(0.8 * PLAN[0, :3] + 0.2 * PLAN[0, 1:])
    assert moved[0, 3] == pytest.approx(PLAN[0, 3])
