"""What is in force, read by robot."""

from dataclasses import replace

from solver.directives import Pairing
from tests.solver.snapshots import random_snapshot


def test_rows_are_the_targets_of_each_robot_that_has_any() -> None:
    for seed in range(20):
        snapshot = random_snapshot(seed, 5, 9, 3)
        directives = snapshot.directives
        rows = directives.rows()
        for robot_id in snapshot.robots.ids:
            assert rows.get(robot_id, ()) == directives.targets_of(robot_id)
        pairs = {Pairing(i, j) for i, row in rows.items() for j in row}
        assert pairs == directives.assignment
        assert all(rows.values())


def test_a_zone_that_nothing_was_said_of_has_severity_one() -> None:
    directives = replace(random_snapshot(0, 1, 1, 1).directives, severities=(("s1", 2.5),))
    assert directives.severity_of("s1") == 2.5
    assert directives.severity_of("s2") == 1.0
