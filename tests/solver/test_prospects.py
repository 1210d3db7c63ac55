"""What rows promise at the edges: nothing held, nothing seen, and the middle of a zone."""

from dataclasses import replace

import numpy as np
import pytest

from solver.arrays import frozen
from solver.problem import SensorModel
from solver.prospects import AssignmentSettings, Prospects
from solver.roster import roster_of
from solver.sensing import information
from solver.snapshot import Snapshot
from solver.zones import Zone, ZoneKind
from tests.solver.snapshots import blinded, random_snapshot

SENSOR, SETTINGS = SensorModel(), AssignmentSettings()
ZONE = Zone("s1", ZoneKind.SENSING, (1.0, 2.0), ((0.5, 0.2), (0.2, 0.3)), 0.25, 0.05)


def prospects(snapshot: Snapshot) -> Prospects:
    return Prospects(snapshot, roster_of(snapshot), SENSOR, SETTINGS)


def hovering(kind: ZoneKind = ZoneKind.SENSING) -> Snapshot:
    """Return one robot and one target that rests, both in the middle of a zone."""
    snapshot = random_snapshot(0, 1, 1, 1, zones=(replace(ZONE, kind=kind),))
    return replace(
        snapshot,
        robots=replace(snapshot.robots, positions=frozen([ZONE.mean])),
        tracks=replace(
            snapshot.tracks, positions=frozen([ZONE.mean]), velocities=frozen([[0.0, 0.0]])
        ),
    )


@pytest.mark.parametrize("kind", ZoneKind)
def test_from_the_middle_of_a_zone_the_way_out_is_east(kind: ZoneKind) -> None:
    """A communication zone's margin depends on the team: its core counts."""
    _, gained = prospects(hovering(kind)).row(np.array([0]), np.array([[0]]))
    radius = ZONE.quantile() * np.sqrt(0.5) + (ZONE.margin if kind is ZoneKind.SENSING else 0.0)
    expected = information(SENSOR, np.array([radius, 0.0]))
    for step in range(SETTINGS.steps):
        np.testing.assert_allclose(gained[0, 0, step], expected, rtol=1e-9)


def test_a_row_of_nothing_promises_nothing_in_a_team_with_one_target() -> None:
    traces, gained = prospects(hovering()).row(np.array([0]), np.array([[-1]]))
    np.testing.assert_array_equal(traces, [[0.0]])
    np.testing.assert_array_equal(gained, np.zeros((1, 1, SETTINGS.steps, 2, 2)))


def test_who_does_not_see_promises_what_nobody_would() -> None:
    promise = prospects(blinded(hovering(), 21))
    traces, gained = promise.row(np.array([0]), np.array([[0]]))
    np.testing.assert_allclose(traces[0], promise.unseen)
    assert not gained.any()
