"""Columns: every set of targets a robot may hold, every choice of one per robot, the best one."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from solver.arrays import FloatArray
from solver.columns import all_matrices, best_columns, columns_of, count_columns
from solver.observations import Link
from solver.roster import UNCOVERED, UNSIGHTED, least_price_cover, roster_of
from tests.solver.snapshots import directed, pin, random_snapshot, with_links
from tests.solver.teams import SETTINGS, TROUBLES, sets_of, team


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


@pytest.mark.parametrize("trouble", TROUBLES)
@pytest.mark.parametrize("capacity", [0, 1, 2, 5])
def test_a_column_is_a_set_that_its_robot_may_hold(trouble: str, capacity: int) -> None:
    roster, _, _ = team(1, 4, 4, capacity, trouble)
    columns = columns_of(roster)
    for robot, sets in enumerate(columns):
        assert sorted(sets) == sorted(sets_of(roster, robot))
    assert count_columns(roster) == sum(len(sets) for sets in columns)


@pytest.mark.parametrize(("seed", "overlap"), [(0, 0.0), (1, 0.5), (2, 1.0), (3, 1.0)])
@pytest.mark.parametrize("trouble", TROUBLES)
def test_no_other_choice_is_cheaper(trouble: str, seed: int, overlap: float) -> None:
    roster, prospects, _ = team(seed, 4, 3, 2, trouble)
    gains: dict[tuple[int, tuple[int, ...]], FloatArray] = {}
    most = np.zeros(3)
    for robot in range(4):
        for chosen in sets_of(roster, robot):
            gain = np.zeros(3)
            if chosen and roster.seeing[robot] and roster.free[robot]:
                traces, _ = prospects.row(np.array([robot]), np.array([chosen]))
                gain[list(chosen)] = prospects.unseen[list(chosen)] - traces[0]
            gains[robot, chosen] = gain
            most = np.maximum(most, overlap * gain)

    def price(rows: tuple[tuple[int, ...], ...]) -> float:
        held, seen, total = np.zeros(3), np.zeros(3), 0.0
        for robot, chosen in enumerate(rows):
            new = sum(not roster.current[robot, j] for j in chosen)
            total += SETTINGS.switching_cost * new - gains[robot, chosen].sum()
            held[list(chosen)] += 1
            seen[list(chosen)] += bool(roster.seeing[robot])
        total += UNCOVERED * (held == 0).sum() + UNSIGHTED * (seen == 0).sum()
        return float(total + (most * np.maximum(seen - 1, 0)).sum())

    found = best_columns(roster, prospects, SETTINGS, overlap)
    rows = tuple(tuple(np.flatnonzero(row).tolist()) for row in found)
    least = min(price(each) for each in product(*(sets_of(roster, i) for i in range(4))))
    assert price(rows) == pytest.approx(least, rel=1e-9, abs=1e-6)


def test_without_an_answer_of_the_solvers_the_targets_are_covered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("solver.columns.milp", lambda *_, **__: SimpleNamespace(x=None))
    roster, prospects, _ = team(1, 4, 3, 2, "all")
    nothing = np.zeros(roster.current.shape)
    np.testing.assert_array_equal(
        best_columns(roster, prospects, SETTINGS, 1.0), least_price_cover(roster, nothing, nothing)
    )
