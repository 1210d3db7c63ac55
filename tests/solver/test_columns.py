"""Columns: every set of targets a robot may hold, and every choice of one per robot."""

from itertools import product

import numpy as np

from solver.columns import all_matrices, columns_of, count_columns
from solver.observations import Link
from solver.roster import roster_of
from tests.solver.snapshots import directed, pin, random_snapshot, with_links


def test_columns_keep_what_is_fixed_and_leave_out_what_is_forbidden() -> None:
    snapshot = directed(
        random_snapshot(5, 3, 3, 2), pins=(pin(21, 122), pin(22, 123, "q", forbids=True))
    )
    roster = roster_of(with_links(snapshot, r23=Link.LOST))
    columns = columns_of(roster)
    assert columns[0] == [(0,), (0, 1), (0, 2)]
    assert columns[1] == [(), (0,), (2,), (0, 2)]
    assert columns[2] == [()]
    assert count_columns(roster) == 3 + 4 + 1


def test_every_choice_once_in_the_order_of_a_product() -> None:
    roster = roster_of(random_snapshot(6, 3, 3, 2))
    columns = columns_of(roster)
    found = all_matrices(roster, columns)
    expected = [[np.isin(range(3), row) for row in choice] for choice in product(*columns)]
    np.testing.assert_array_equal(found, np.array(expected))


def test_more_robots_than_an_array_has_axes() -> None:
    roster = roster_of(
        with_links(random_snapshot(6, 70, 2, 1), **{f"r{k}": Link.LOST for k in range(22, 91)})
    )
    found = all_matrices(roster, columns_of(roster))
    assert found.shape == (3, 70, 2)
    assert found[:, 0].tolist() == [[False, False], [True, False], [False, True]]
    assert not found[:, 1:].any()
