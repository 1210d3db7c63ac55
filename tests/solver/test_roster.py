"""Who may track what, read off a snapshot entry by entry."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from solver.arrays import BoolArray
from solver.directives import Pairing
from solver.observations import Link
from solver.roster import (
    UNCOVERED,
    UNSIGHTED,
    Roster,
    cover,
    least_price_cover,
    roster_of,
)
from solver.snapshot import Snapshot, TrackStatus
from tests.solver.snapshots import blinded, directed, dropped, pin, random_snapshot, with_links
from tests.solver.teams import TROUBLES, allowed, sets_of, team


def matrix(rows: list[str]) -> BoolArray:
    """Return a matrix drawn with x for a pair."""
    return np.array([[entry == "x" for entry in row] for row in rows])


def assigned(*rows: tuple[int, ...], capacity: int = 2) -> Snapshot:
    """Return a snapshot in which robots 21, 22, ... hold these of four targets."""
    pairs = {Pairing(21 + i, j) for i, row in enumerate(rows) for j in row}
    return directed(random_snapshot(0, len(rows), 4, capacity), assignment=frozenset(pairs))


def test_a_sound_team_is_read_as_it_stands() -> None:
    roster = roster_of(assigned((122, 125), (123,), ()))
    assert roster.robot_ids == (21, 22, 23)
    assert roster.target_ids == (122, 123, 124, 125)
    assert roster.target_rows.tolist() == [0, 1, 2, 3]
    np.testing.assert_array_equal(roster.current, matrix(["x..x", ".x..", "...."]))
    assert roster.free.all()
    assert roster.seeing.all()
    assert roster.placed.all()
    assert roster.capacity.tolist() == roster.spare.tolist() == [2, 2, 2]
    assert not roster.fixed.any()
    assert not roster.forbidden.any()
    held = roster.pairs(roster.current)
    assert held == {Pairing(21, 122), Pairing(21, 125), Pairing(22, 123)}


def test_lost_jammed_and_blind_robots() -> None:
    snapshot = assigned((122, 125), (123,), (124,), (122,))
    roster = roster_of(blinded(with_links(snapshot, r21=Link.LOST, r22=Link.JAMMED), 23, 21))
    assert roster.free.tolist() == [False, False, True, True]
    assert roster.seeing.tolist() == [False, True, False, True]
    np.testing.assert_array_equal(roster.current, matrix(["....", ".x..", "..x.", "x..."]))
    np.testing.assert_array_equal(roster.fixed, matrix(["....", ".x..", "....", "...."]))
    assert roster.capacity.tolist() == [0, 1, 2, 2]
    assert roster.spare.tolist() == [0, 0, 2, 2]
    assert cover(roster, roster.current) == (3, 2)


def test_capacities_are_what_was_asked_for_within_reason() -> None:
    asked = ((21, 9), (22, -1), (24, 3), (99, 2))
    roster = roster_of(directed(assigned((), (), (), ()), capacities=asked))
    assert roster.capacity.tolist() == [4, 0, 0, 3]


def test_dropped_targets_do_not_count_and_unknown_ones_have_no_place() -> None:
    snapshot = dropped(assigned((122, 123), (125,)), 123)
    known = snapshot.tracks.status
    status = (TrackStatus.COASTING, known[1], TrackStatus.UNKNOWN, known[3])
    roster = roster_of(replace(snapshot, tracks=replace(snapshot.tracks, status=status)))
    assert roster.target_ids == (122, 124, 125)
    assert roster.target_rows.tolist() == [0, 2, 3]
    assert roster.placed.tolist() == [True, False, True]
    np.testing.assert_array_equal(roster.current, matrix(["x..", "..x"]))


def test_pairs_of_nobody_are_left_out() -> None:
    strangers = frozenset({Pairing(99, 122), Pairing(21, 999), Pairing(22, 124)})
    roster = roster_of(directed(assigned((), ()), assignment=strangers))
    np.testing.assert_array_equal(roster.current, matrix(["....", "..x."]))


@pytest.mark.parametrize(
    ("expires_s", "stands"), [(None, True), (10.5, True), (10.0, False), (9.0, False)]
)
def test_a_pin_stands_until_it_expires(expires_s: float | None, stands: bool) -> None:
    """The snapshot's time is 10 s."""
    for comment_id in (None, "c1"):
        one = pin(22, 124, expires_s=expires_s, comment_id=comment_id)
        assert roster_of(directed(assigned((), ()), pins=(one,))).fixed[1, 2] == stands


def test_pins_of_who_cannot_be_told_or_is_not_there_do_not_stand() -> None:
    snapshot = with_links(assigned((), (122,), (), ()), r21=Link.LOST, r22=Link.JAMMED)
    snapshot = dropped(snapshot, 125)
    pins = (
        pin(21, 122, "a"),
        pin(22, 123, "b"),
        pin(22, 122, "c", forbids=True),
        pin(23, 125, "d"),
        pin(99, 122, "e"),
        pin(23, 999, "f"),
        pin(24, 123, "g", forbids=True),
    )
    roster = roster_of(directed(snapshot, pins=pins))
    np.testing.assert_array_equal(roster.fixed, matrix(["...", "x..", "...", "..."]))
    np.testing.assert_array_equal(roster.forbidden, matrix(["...", "...", "...", ".x."]))


def test_of_two_pins_that_contradict_each_other_the_newer_one_stands() -> None:
    snapshot = assigned((), (), capacity=1)
    both = (pin(21, 122, "old"), pin(21, 122, "new", forbids=True))
    assert roster_of(directed(snapshot, pins=both)).forbidden[0, 0]
    assert not roster_of(directed(snapshot, pins=both)).fixed.any()
    roster = roster_of(directed(snapshot, pins=both[::-1]))
    assert roster.fixed[0, 0]
    assert not roster.forbidden.any()
    full = (pin(21, 122, "old"), pin(21, 123, "new"))
    np.testing.assert_array_equal(
        roster_of(directed(snapshot, pins=full)).fixed, matrix([".x..", "...."])
    )


def test_an_operators_pin_comes_before_a_comments() -> None:
    snapshot = assigned((), (), capacity=1)
    pins = (pin(21, 122, "operator"), pin(21, 123, "comment", comment_id="c1"))
    np.testing.assert_array_equal(
        roster_of(directed(snapshot, pins=pins)).fixed, matrix(["x...", "...."])
    )


@pytest.mark.parametrize("trouble", TROUBLES)
def test_the_cover_is_the_cheapest_of_the_widest(trouble: str) -> None:
    for seed in range(3):
        roster, _, _ = team(seed, 4, 4, 1, trouble)
        rng = np.random.default_rng(seed)
        prices = rng.uniform(0.0, 100.0, size=(4, 4))
        found = least_price_cover(roster, prices, np.zeros((4, 4)))
        assert allowed(roster, found)
        best = min(
            (price(roster, prices, each) for each in every(roster)), key=lambda each: each[0]
        )
        assert price(roster, prices, found)[0] == pytest.approx(best[0])


def every(roster: Roster) -> list[BoolArray]:
    """Return every matrix of sets that the robots may hold."""
    found = []
    for rows in product(*(sets_of(roster, i) for i in range(len(roster.robot_ids)))):
        each = np.zeros_like(roster.current)
        for i, row in enumerate(rows):
            each[i, list(row)] = True
        found.append(each)
    return found


def price(roster: Roster, prices: np.ndarray, held: BoolArray) -> tuple[float, BoolArray]:
    """Return what a matrix costs: lack of cover and of sight first, then its new pairs."""
    count, seen = cover(roster, held)
    targets = held.shape[1]
    lack = UNCOVERED * (targets - count) + UNSIGHTED * (targets - seen)
    return lack + float(prices[held & ~roster.fixed].sum()), held


def test_taking_a_current_ones_place_costs_what_is_told() -> None:
    """One robot with two places of which one is taken, another with two free ones."""
    roster = roster_of(assigned((122,), ()))
    prices = np.where(roster.current, 0.0, 1.0)
    prices[0, 1:] = 0.9
    displacing = np.where(roster.current, 0.0, 5.0)
    found = least_price_cover(roster, prices, displacing)
    np.testing.assert_array_equal(found.sum(axis=1), [2, 2])
    assert found[0, 0]
    full = roster_of(assigned((122, 123), ()))
    prices = np.where(full.current, 0.0, 1.0)
    prices[0, 2:] = 0.1
    found = least_price_cover(full, prices, np.where(full.current, 0.0, 5.0))
    np.testing.assert_array_equal(found, matrix(["xx..", "..xx"]))
    found = least_price_cover(full, prices, np.zeros_like(prices))
    np.testing.assert_array_equal(found.sum(axis=1), [2, 2])
