"""Local search ends where no single change helps; every change is looked at here by hand."""

from collections.abc import Iterator

import numpy as np
import pytest

from solver.arrays import BoolArray
from solver.prospects import Prospects
from solver.roster import Roster, cover, least_price_cover
from solver.surplus import topped_up
from solver.swaps import improved, swapped
from tests.solver.teams import SETTINGS, TROUBLES, allowed, team

TEAM = (5, 6, 2)


def first_cover(roster: Roster) -> BoolArray:
    nothing = np.zeros(roster.current.shape)
    return least_price_cover(roster, nothing, nothing)


def flipped(matrix: BoolArray, *pairs: tuple[int, int]) -> BoolArray:
    changed = matrix.copy()
    for i, j in pairs:
        changed[i, j] ^= True
    return changed


def single_changes(roster: Roster, matrix: BoolArray) -> Iterator[BoolArray]:
    """Yield what a pair more, less or moved, or two exchanged, make of a matrix."""
    robots, targets = matrix.shape
    pairs = [(i, j) for i in range(robots) for j in range(targets)]
    trials = [flipped(matrix, pair) for pair in pairs]
    held = [pair for pair in pairs if matrix[pair]]
    for i, j in held:
        trials += [flipped(matrix, (i, j), (i, k)) for k in range(targets) if not matrix[i, k]]
        trials += [flipped(matrix, (i, j), (r, j)) for r in range(robots) if not matrix[r, j]]
        trials += [
            flipped(matrix, (i, j), (r, k), (i, k), (r, j))
            for r, k in held
            if r != i and k != j and not matrix[i, k] and not matrix[r, j]
        ]
    return (trial for trial in trials if allowed(roster, trial))


@pytest.mark.parametrize("trouble", TROUBLES)
def test_nothing_single_improves_what_is_improved(trouble: str) -> None:
    for seed in range(3):
        roster, prospects, appraisal = team(seed, *TEAM, trouble)
        starts = [first_cover(roster), roster.fixed.copy()]
        found = improved(roster, prospects, SETTINGS, starts)
        assert allowed(roster, found)
        price = float(appraisal.prices(found[None])[0])
        assert price <= appraisal.prices(np.stack(starts)).min()
        others = np.stack(list(single_changes(roster, found)))
        assert price <= appraisal.prices(others).min() + 1e-6


def test_new_pairs_that_are_not_worth_their_price_are_let_go() -> None:
    """From everybody on everything there is no other way on than a pair less."""
    for seed in range(4):
        roster, prospects, appraisal = team(seed, 4, 3, 3)
        start = ~roster.forbidden & roster.free[:, None]
        found = improved(roster, prospects, SETTINGS, [start])
        price = float(appraisal.prices(found[None])[0])
        others = np.stack(list(single_changes(roster, found)))
        assert price <= appraisal.prices(others).min() + 1e-6
        assert found.sum() < start.sum()


def worth(prospects: Prospects, roster: Roster, matrix: BoolArray, robot: int) -> float:
    """Return the price of one robot's row by itself."""
    row = np.flatnonzero(matrix[robot])
    if not len(row):
        return 0.0
    traces, _ = prospects.row(np.array([robot]), row[None])
    saved = float((prospects.unseen[row] - traces[0]).sum())
    return SETTINGS.switching_cost * int((~roster.current[robot, row]).sum()) - saved


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("trouble", TROUBLES)
def test_no_exchange_between_two_rows_improves_what_is_swapped(trouble: str, seed: int) -> None:
    roster, prospects, _ = team(seed, *TEAM, trouble)
    start = first_cover(roster)
    found = swapped(roster, prospects, SETTINGS, start)
    assert allowed(roster, found)
    assert cover(roster, found) == cover(roster, start)
    able = np.flatnonzero(roster.free & roster.seeing).tolist()

    def price(matrix: BoolArray) -> float:
        return sum(worth(prospects, roster, matrix, robot) for robot in able)

    assert price(found) <= price(start) + 1e-9
    for trial in single_changes(roster, found):
        touched = np.flatnonzero((trial != found).any(axis=1))
        if len(touched) == 2 and set(touched.tolist()) <= set(able):
            assert price(trial) >= price(found) - 1e-6
    if not np.array_equal(start, found):
        assert price(found) < price(start)


def test_a_start_is_never_written_to() -> None:
    roster, prospects, _ = team(0, *TEAM)
    start = first_cover(roster)
    before = start.copy()
    for search in (swapped, topped_up):
        search(roster, prospects, SETTINGS, start)
        np.testing.assert_array_equal(start, before)


def test_one_robot_has_nobody_to_exchange_with() -> None:
    roster, prospects, _ = team(0, 1, 3, 2)
    start = first_cover(roster)
    np.testing.assert_array_equal(swapped(roster, prospects, SETTINGS, start), start)


@pytest.mark.parametrize("trouble", TROUBLES)
def test_no_second_robot_more_or_less_improves_what_is_topped_up(trouble: str) -> None:
    for seed in range(3):
        roster, prospects, appraisal = team(seed, 5, 6, 3, trouble)
        start = swapped(roster, prospects, SETTINGS, first_cover(roster))
        found = topped_up(roster, prospects, SETTINGS, start)
        assert allowed(roster, found)
        assert cover(roster, found) >= cover(roster, start)
        price = float(appraisal.prices(found[None])[0])
        assert price <= float(appraisal.prices(start[None])[0])
        able = set(np.flatnonzero(roster.free & roster.seeing).tolist())
        for trial in single_changes(roster, found):
            touched = np.flatnonzero((trial != found).any(axis=1)).tolist()
            if len(touched) == 1 and touched[0] in able:
                assert float(appraisal.prices(trial[None])[0]) >= price - 1e-6
