"""The verification, written apart from the solver, accepts whatever the solver assigns."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from llm.verification import Limits, beta, verify
from solver import assignment
from solver.assignment import AssignmentSettings
from solver.directives import Pairing, Proposal, Source
from solver.observations import Link
from solver.problem import SensorModel
from solver.roster import cover, least_price_cover, roster_of
from solver.snapshot import Snapshot
from tests.patience import slowness
from tests.solver.snapshots import blinded, directed, dropped, pin, random_snapshot, with_links

LINKS = (Link.CONNECTED, Link.CONNECTED, Link.JAMMED, Link.LOST)


def battered(seed: int) -> Snapshot:
    """Return a small team with failures, losses and contradicting pins."""
    rng = np.random.default_rng(seed)
    robots, targets = int(rng.integers(1, 5)), int(rng.integers(1, 7))
    snapshot = random_snapshot(seed, robots, targets, int(rng.integers(0, 4)))
    ids = snapshot.robots.ids
    snapshot = with_links(snapshot, **{f"r{i}": LINKS[int(rng.integers(4))] for i in ids})
    snapshot = blinded(snapshot, *(i for i in ids if rng.random() < 0.3))
    snapshot = dropped(snapshot, *(t for t in snapshot.tracks.ids if rng.random() < 0.15))
    pins = tuple(
        pin(
            int(rng.choice(ids)),
            int(rng.choice(snapshot.tracks.ids)),
            f"p{k}",
            forbids=bool(rng.random() < 0.4),
            comment_id=None if rng.random() < 0.4 else f"c{k}",
        )
        for k in range(int(rng.integers(0, 4)))
    )
    return directed(
        snapshot, pins=pins, capacities=tuple((i, int(rng.integers(0, 4))) for i in ids)
    )


def proposed(pairs: frozenset[Pairing]) -> Proposal:
    robots = sorted({pair.robot_id for pair in pairs})
    rows = ((i, tuple(sorted(p.target_id for p in pairs if p.robot_id == i))) for i in robots)
    return Proposal(id="x", source=Source.EXACT, asked_s=10.0, assignment=tuple(rows))


@pytest.mark.parametrize("most_columns", [3000, 0], ids=["exact", "search"])
@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_assignments_are_accepted(most_columns: int, seed: int) -> None:
    snapshot = battered(seed)
    chosen = AssignmentSettings(most_columns=most_columns)
    found = assignment.assign(snapshot, SensorModel(), chosen)
    limits = Limits.around(snapshot.directives.weights)
    assert beta(found, snapshot) == 0
    assert verify(proposed(found), snapshot, limits).violations == ()


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_repairs_are_accepted(seed: int) -> None:
    snapshot = battered(seed)
    found = assignment.repair(snapshot)
    limits = Limits.around(snapshot.directives.weights)
    assert beta(found, snapshot) == 0
    assert verify(proposed(found), snapshot, limits).violations == ()


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_comments_pin_gives_way_exactly_where_it_would_cost_cover(seed: int) -> None:
    """Entered one by one, newest first, as one would by hand."""
    snapshot = battered(seed)
    rng = np.random.default_rng(seed)
    ids, targets = snapshot.robots.ids, snapshot.tracks.ids
    pins = tuple(
        pin(
            int(rng.choice(ids)),
            int(rng.choice(targets)),
            f"p{k}",
            forbids=bool(rng.random() < 0.4),
            comment_id=f"c{k}",
        )
        for k in range(int(rng.integers(2, 9)))
    )
    found = roster_of(directed(snapshot, pins=pins))
    by_hand = roster_of(directed(snapshot, pins=()))
    nothing = np.zeros(by_hand.current.shape)
    whole = cover(by_hand, least_price_cover(by_hand, nothing, nothing))
    for one in reversed(pins):
        if one.pair.target_id not in by_hand.target_ids:
            continue
        i = by_hand.robot_ids.index(one.pair.robot_id)
        j = by_hand.target_ids.index(one.pair.target_id)
        settled = by_hand.fixed[i, j] or by_hand.forbidden[i, j]
        has_room = one.forbids or by_hand.spare[i] > 0
        if settled or not by_hand.free[i] or not has_room:
            continue
        table = by_hand.forbidden if one.forbids else by_hand.fixed
        table[i, j] = True
        if cover(by_hand, least_price_cover(by_hand, nothing, nothing)) != whole:
            table[i, j] = False
    np.testing.assert_array_equal(found.fixed, by_hand.fixed)
    np.testing.assert_array_equal(found.forbidden, by_hand.forbidden)


def test_repair_is_quick_for_large_teams_however_much_people_asked_for() -> None:
    snapshot = with_links(random_snapshot(0, 64, 128, 3, room=30.0), r21=Link.LOST)
    pins = tuple(pin(21 + k, 122 + 7 * k % 128, f"p{k}", comment_id=f"c{k}") for k in range(1, 60))
    snapshot = directed(snapshot, pins=pins)
    taken = []
    for _ in range(5):
        began = time.thread_time()
        found = assignment.repair(snapshot)
        taken.append(time.thread_time() - began)
    assert {one.pair for one in pins} <= found
    assert {pair.target_id for pair in found} == set(snapshot.tracks.ids)
    assert min(taken) < 0.010 * slowness()
