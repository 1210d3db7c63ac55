"""The team as the verification reads it off a snapshot."""

from llm.coverage import Team
from solver.directives import Pairing
from solver.observations import Link
from tests.solver.snapshots import blinded, directed, dropped, random_snapshot, with_links


def test_the_team_is_read_robot_by_robot() -> None:
    held = frozenset({Pairing(22, 123), Pairing(22, 124), Pairing(23, 125), Pairing(21, 122)})
    snapshot = directed(
        random_snapshot(0, 5, 4, 2),
        assignment=held,
        capacities=((21, 2), (22, 2), (23, 9), (24, -3)),
    )
    snapshot = with_links(snapshot, r21=Link.LOST, r22=Link.JAMMED)
    team = Team.of(dropped(blinded(snapshot, 21, 23), 124))
    assert team.targets == (122, 123, 125)
    assert team.dropped == {124}
    assert team.links == dict(zip(snapshot.robots.ids, snapshot.robots.links, strict=True))
    assert team.blind == {21, 23}
    assert team.frozen == {22: {123}}
    # Lost: none. Jammed: what it holds. More than there is, less than nothing, nothing said.
    assert team.capacities == {21: 0, 22: 1, 23: 3, 24: 0, 25: 0}
    assert team.sighted() == {22, 24, 25}


def test_capacities_that_are_asked_for_take_the_place_of_those_in_force() -> None:
    snapshot = with_links(random_snapshot(0, 3, 4, 1), r21=Link.LOST)
    assert Team.of(snapshot, {21: 3, 22: 3}).capacities == {21: 0, 22: 3, 23: 0}
    assert Team.of(snapshot).capacities == {21: 0, 22: 1, 23: 1}
