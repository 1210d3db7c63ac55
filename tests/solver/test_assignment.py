"""Assignments against brute force, and least repairs against every smaller one."""

import time
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import assignment
from solver.appraisal import Appraisal
from solver.arrays import BoolArray, FloatArray, frozen
from solver.assignment import AssignmentSettings
from solver.directives import Pairing
from solver.observations import Link
from solver.problem import SensorModel
from solver.prospects import Prospects
from solver.roster import Roster, cover, roster_of
from solver.sensing import information
from solver.snapshot import Snapshot
from solver.zones import Zone, ZoneKind
from tests.patience import slowness
from tests.solver.snapshots import (
    blinded,
    directed,
    dropped,
    pin,
    random_snapshot,
    with_links,
)

SENSOR = SensorModel()
SETTINGS = AssignmentSettings()
seeds = st.integers(0, 2**32 - 1)


def matrix_of(roster: Roster, pairs: frozenset[Pairing]) -> BoolArray:
    matrix = np.zeros(roster.current.shape, dtype=np.bool_)
    for pair in pairs:
        i, j = roster.robot_ids.index(pair.robot_id), roster.target_ids.index(pair.target_id)
        matrix[i, j] = True
    return matrix


def every_matrix(roster: Roster) -> list[BoolArray]:
    rows = []
    targets = range(len(roster.target_ids))
    for i, capacity in enumerate(roster.capacity.tolist()):
        sets = [s for size in range(capacity + 1) for s in combinations(targets, size)]
        choices = [np.isin(targets, s) for s in sets]
        allowed = [c for c in choices if (c >= roster.fixed[i]).all()]
        allowed = [c for c in allowed if not (c & roster.forbidden[i]).any()]
        rows.append(allowed if roster.free[i] else [roster.fixed[i]])
    return [np.array(choice) for choice in product(*rows)]


def price(appraisal: Appraisal, matrix: BoolArray) -> float:
    return float(appraisal.prices(matrix[None])[0])


def judge(snapshot: Snapshot) -> tuple[Roster, Appraisal]:
    roster = roster_of(snapshot)
    prospects = Prospects(snapshot, roster, SENSOR, SETTINGS)
    return roster, Appraisal(roster, prospects, SETTINGS)


@settings(max_examples=15)
@given(seed=seeds, shape=st.sampled_from([(2, 4, 2), (3, 3, 1), (2, 6, 3), (3, 6, 2)]))
def test_full_teams_get_the_best_of_all_assignments(seed: int, shape: tuple[int, int, int]) -> None:
    snapshot = random_snapshot(seed, *shape)
    roster, appraisal = judge(snapshot)
    found = matrix_of(roster, assignment.assign(snapshot, SENSOR, SETTINGS))
    least = min(
        price(appraisal, matrix)
        for matrix in every_matrix(roster)
        if cover(roster, matrix) == (shape[1], shape[1])
    )
    assert price(appraisal, found) == pytest.approx(least, rel=1e-9)


def test_surplus_capacity_is_used_within_a_percent_of_the_best() -> None:
    gaps = []
    for seed in range(12):
        snapshot = random_snapshot(seed, 3, 3, 2, room=3.0)
        roster, appraisal = judge(snapshot)
        found = price(appraisal, matrix_of(roster, assignment.assign(snapshot, SENSOR, SETTINGS)))
        least = min(price(appraisal, matrix) for matrix in every_matrix(roster))
        gaps.append(found / least - 1.0)
    assert max(gaps) < 0.01
    assert np.median(gaps) < 1e-9


@settings(max_examples=12)
@given(seed=seeds, data=st.data())
def test_failures_pins_and_capacities_against_brute_force(seed: int, data: st.DataObject) -> None:
    snapshot = random_snapshot(seed, 3, 4, 2, room=3.0)
    links = data.draw(st.sampled_from([{}, {"r21": Link.LOST}, {"r22": Link.JAMMED}]))
    snapshot = with_links(snapshot, **links)
    snapshot = blinded(snapshot, *data.draw(st.sampled_from([(), (23,), (21, 23)])))
    pins = data.draw(
        st.sampled_from(
            [
                (),
                (pin(23, 122), pin(23, 125, "q", forbids=True)),
                (pin(21, 124, comment_id="c1"),),
            ]
        )
    )
    capacities = data.draw(st.sampled_from([(2, 2, 2), (1, 2, 1), (0, 3, 1)]))
    snapshot = directed(
        snapshot, pins=pins, capacities=tuple(zip((21, 22, 23), capacities, strict=True))
    )
    roster, appraisal = judge(snapshot)
    found = matrix_of(roster, assignment.assign(snapshot, SENSOR, SETTINGS))
    assert (found.sum(axis=1) <= roster.capacity).all()
    assert not (found & roster.forbidden).any()
    assert (found >= roster.fixed).all()
    matrices = every_matrix(roster)
    assert cover(roster, found) == max(cover(roster, matrix) for matrix in matrices)
    least = min(price(appraisal, matrix) for matrix in matrices)
    assert price(appraisal, found) <= least + 0.02 * abs(least)


def test_the_price_is_the_predicted_trace_step_by_step() -> None:
    """One robot, two targets, nothing vectorised."""
    snapshot = random_snapshot(5, 1, 2, 2)
    _, appraisal = judge(snapshot)
    x = snapshot.robots.positions[0]
    y, v = snapshot.tracks.positions, snapshot.tracks.velocities

    def flown(place: int) -> float:
        total = 0.0
        P: list[FloatArray] = [snapshot.tracks.covariances[j] for j in range(2)]
        for k in range(1, SETTINGS.steps + 1):
            t = k * SETTINGS.step_s
            at = y + t * v
            goal = at[place] if place < 2 else at.mean(axis=0)
            distance = float(np.hypot(*(goal - x)))
            gone = min(SETTINGS.speed_m_s * t, max(distance - 0.35, 0.0))
            position = x + (gone / distance) * (goal - x)
            for j in range(2):
                prior = P[j] + SETTINGS.process_noise * SETTINGS.step_s * np.eye(2)
                gained = information(SENSOR, position - at[j])
                P[j] = np.asarray(np.linalg.inv(np.linalg.inv(prior) + gained), dtype=np.float64)
                total += float(np.trace(P[j]))
        return total

    matrix = np.ones((1, 2), dtype=np.bool_)
    changes = 2 - len(snapshot.directives.assignment)
    expected = min(flown(place) for place in range(3)) + SETTINGS.switching_cost * changes
    assert price(appraisal, matrix) == pytest.approx(expected, rel=1e-9)


def test_each_robot_gets_what_is_near_it() -> None:
    snapshot = random_snapshot(0, 2, 4, 2)
    positions = np.array([[-4.0, 0.0], [4.0, 0.0]])
    targets = np.array([[4.0, 1.0], [-4.0, 1.0], [4.0, -1.0], [-4.0, -1.0]])
    snapshot.robots.positions.setflags(write=True)
    snapshot.robots.positions[:] = positions
    snapshot.tracks.positions.setflags(write=True)
    snapshot.tracks.positions[:] = targets
    found = assignment.assign(snapshot, SENSOR, SETTINGS)
    assert found == {
        Pairing(21, 123),
        Pairing(21, 125),
        Pairing(22, 122),
        Pairing(22, 124),
    }


def test_a_small_gain_does_not_turn_the_team_around() -> None:
    snapshot = random_snapshot(4, 3, 3, 1)
    keen = AssignmentSettings(switching_cost=0.0)
    lazy = AssignmentSettings(switching_cost=1e3)
    changed = assignment.assign(snapshot, SENSOR, keen) - snapshot.directives.assignment
    assert changed
    assert assignment.assign(snapshot, SENSOR, lazy) == snapshot.directives.assignment


def test_a_known_zone_over_a_target_makes_it_worth_less_to_those_who_know() -> None:
    zone = Zone("s1", ZoneKind.SENSING, (0.0, 0.0), ((1.0, 0.0), (0.0, 1.0)), 0.5, 0.05)
    snapshot = random_snapshot(1, 1, 1, 1, zones=(zone,))
    snapshot.tracks.positions.setflags(write=True)
    snapshot.tracks.positions[:] = 0.0
    roster = roster_of(snapshot)
    one = np.array([0])
    feared, _ = Prospects(snapshot, roster, SENSOR, SETTINGS).row(one, one[:, None])
    snapshot.known.setflags(write=True)
    snapshot.known[:] = False
    ignored, _ = Prospects(snapshot, roster, SENSOR, SETTINGS).row(one, one[:, None])
    assert feared[0, 0] > 1.2 * ignored[0, 0]


def test_a_severe_zone_is_kept_away_from_further() -> None:
    zone = Zone("s1", ZoneKind.SENSING, (0.0, 0.0), ((1.0, 0.0), (0.0, 1.0)), 0.2, 0.05)
    snapshot = random_snapshot(1, 1, 1, 1, zones=(zone,))
    snapshot = replace(snapshot, tracks=replace(snapshot.tracks, positions=frozen([[0.0, 0.0]])))
    roster, one = roster_of(snapshot), np.array([0])
    prices = []
    for severities in ((), (("s1", 4.0),), (("s2", 4.0),)):
        graver = directed(snapshot, severities=severities)
        traces, _ = Prospects(graver, roster, SENSOR, SETTINGS).row(one, one[:, None])
        prices.append(float(traces[0, 0]))
    assert prices[1] > 1.1 * prices[0]
    assert prices[2] == prices[0]


def least_changes(roster: Roster) -> tuple[int, tuple[int, int]]:
    matrices = every_matrix(roster)
    best = max(cover(roster, matrix) for matrix in matrices)
    changes = min(
        int((matrix ^ roster.current).sum()) for matrix in matrices if cover(roster, matrix) == best
    )
    return changes, best


@settings(max_examples=40)
@given(seed=seeds, data=st.data())
def test_repair_changes_as_little_as_any_full_cover(seed: int, data: st.DataObject) -> None:
    snapshot = random_snapshot(seed, 3, 4, 2)
    links = data.draw(
        st.sampled_from(
            [{"r21": Link.LOST}, {"r21": Link.LOST, "r22": Link.JAMMED}, {"r23": Link.JAMMED}, {}]
        )
    )
    snapshot = with_links(snapshot, **links)
    snapshot = blinded(snapshot, *data.draw(st.sampled_from([(), (22,)])))
    snapshot = dropped(snapshot, *data.draw(st.sampled_from([(), (123,)])))
    roster = roster_of(snapshot)
    found = matrix_of(roster, assignment.repair(snapshot))
    changes, best = least_changes(roster)
    assert cover(roster, found) == best
    assert (found.sum(axis=1) <= roster.capacity).all()
    assert int((found ^ roster.current).sum()) <= changes


def test_repair_of_a_sound_assignment_is_itself() -> None:
    snapshot = random_snapshot(2, 4, 6, 2)
    assert assignment.repair(snapshot) == snapshot.directives.assignment


def test_a_short_way_is_no_reason_for_a_change_more() -> None:
    """The lone target's neighbour would have to hand on its own; somebody far off has room."""
    snapshot = random_snapshot(0, 3, 20, 1)
    positions = np.tile([50.0, 1.0], (20, 1))
    positions[1] = (0.0, 0.0)
    held = {Pairing(21, 122), Pairing(23, 123), *(Pairing(22, t) for t in range(124, 142))}
    snapshot = replace(
        directed(snapshot, assignment=frozenset(held), capacities=((21, 1), (22, 20), (23, 1))),
        robots=replace(snapshot.robots, positions=frozen([[0.0, 0.0], [50.0, 1.0], [0.0, 9.0]])),
        tracks=replace(snapshot.tracks, positions=frozen(positions)),
    )
    snapshot = with_links(snapshot, r23=Link.LOST)
    expected = held - {Pairing(23, 123)} | {Pairing(22, 123)}
    assert assignment.repair(snapshot) == expected


def test_repair_is_quick_for_large_teams() -> None:
    snapshot = with_links(random_snapshot(0, 64, 128, 3, room=30.0), r21=Link.LOST, r30=Link.LOST)
    taken = []
    for _ in range(5):
        began = time.thread_time()
        found = assignment.repair(snapshot)
        taken.append(time.thread_time() - began)
    assert {pair.target_id for pair in found} == set(snapshot.tracks.ids)
    assert len(found - snapshot.directives.assignment) == 4
    assert min(taken) < 0.010 * slowness()


@pytest.mark.parametrize("capacity", [2, 3])
def test_the_search_for_large_teams_is_near_the_exact_choice(capacity: int) -> None:
    """Where the exact one can still be had; with three places each there are six to spare."""
    search = AssignmentSettings(most_columns=0)
    gaps = []
    for seed in range(6):
        snapshot = random_snapshot(seed, 6, 12, capacity, room=6.0)
        roster, appraisal = judge(snapshot)
        exact = matrix_of(roster, assignment.assign(snapshot, SENSOR, SETTINGS))
        found = matrix_of(roster, assignment.assign(snapshot, SENSOR, search))
        assert cover(roster, found) == (12, 12)
        assert (found.sum(axis=1) <= capacity).all()
        gaps.append(price(appraisal, found) / price(appraisal, exact) - 1.0)
    assert max(gaps) < 0.05
    assert np.mean(gaps) < 0.02


def test_a_team_of_64_is_assigned_far_better_than_at_random() -> None:
    snapshot = random_snapshot(0, 64, 128, 3, room=16.0)
    snapshot = blinded(with_links(snapshot, r21=Link.LOST, r22=Link.JAMMED), 23)
    roster, appraisal = judge(snapshot)
    found = matrix_of(roster, assignment.assign(snapshot, SENSOR, SETTINGS))
    assert cover(roster, found) == (128, 128)
    assert (found.sum(axis=1) <= roster.capacity).all()
    np.testing.assert_array_equal(found[1], roster.current[1])
    assert price(appraisal, found) < 0.4 * price(appraisal, roster.current)
    single = np.zeros_like(found)
    for j in range(128):
        single[int(np.argmax(found[:, j])), j] = True
    # Second robots are there because they help.
    assert price(appraisal, found) < price(appraisal, single)


@pytest.mark.parametrize(
    "snapshot",
    [
        random_snapshot(0, 0, 3, 1),
        random_snapshot(0, 3, 0, 1),
        random_snapshot(0, 2, 3, 0),
        with_links(random_snapshot(0, 2, 2, 1), r21=Link.LOST, r22=Link.LOST),
    ],
    ids=["no robots", "no targets", "no capacity", "all lost"],
)
def test_nobody_or_nothing_to_assign(snapshot: Snapshot) -> None:
    assert assignment.assign(snapshot, SENSOR, SETTINGS) == frozenset()
    assert assignment.repair(snapshot) == frozenset()


def test_more_targets_than_places_covers_as_many_as_there_are_places() -> None:
    snapshot = random_snapshot(4, 2, 6, 2)
    for found in (assignment.assign(snapshot, SENSOR, SETTINGS), assignment.repair(snapshot)):
        assert len({pair.target_id for pair in found}) == 4


def test_a_large_team_of_which_few_are_left_gets_the_best_of_all_assignments() -> None:
    snapshot = random_snapshot(3, 80, 4, 2)
    few = with_links(snapshot, **{f"r{k}": Link.LOST for k in range(23, 101)})
    roster, appraisal = judge(few)
    found = matrix_of(roster, assignment.assign(few, SENSOR, SETTINGS))
    assert not found[2:].any()
    assert cover(roster, found) == (4, 4)
    least = min(price(appraisal, matrix) for matrix in every_matrix(roster))
    assert price(appraisal, found) == pytest.approx(least, rel=1e-9)


def test_same_snapshot_same_assignment() -> None:
    snapshot = random_snapshot(8, 4, 8, 2)
    first, again = (assignment.assign(snapshot, SENSOR, SETTINGS) for _ in range(2))
    assert first == again
