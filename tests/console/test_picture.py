import numpy as np
import pytest

from console import picture
from console.picture import Trails
from tests.console.messages import message


def test_every_robot_stands_where_it_reported() -> None:
    said = message()
    signs = picture.robots(said)
    assert signs.positions.tolist() == [robot["position"] for robot in said["robots"]]
    assert len(signs.colours) == len(signs.wxyzs) == len(signs.scales) == 4


def test_failures_are_marked_on_the_robot() -> None:
    said = message()
    assert [picture.robot_state(robot) for robot in said["robots"]] == [
        "ok",
        "blind",
        "jammed",
        "ok",
    ]
    marks = picture.failures(said)
    assert marks.colours == [picture.BLIND, picture.JAMMED]
    assert marks.positions.tolist() == [said["robots"][i]["position"] for i in (1, 2)]


def test_assignment_lines_join_each_robot_with_its_targets() -> None:
    said = message()
    lines = picture.assignment_lines(said)
    robots = {robot["id"]: robot["position"] for robot in said["robots"]}
    targets = {target["id"]: target["position"] for target in said["targets"]}
    pairs = [(21, 121), (21, 125), (26, 122), (31, 123), (31, 126), (34, 124)]
    expected = [[robots[r], [*targets[t], 0.05]] for r, t in pairs]
    assert lines.points.tolist() == expected


def test_known_zones_reach_as_far_as_they_repel() -> None:
    said = message()
    signs = picture.zones(said)
    assert signs.scales[:, :2].tolist() == [zone["keep_out_axes_m"] for zone in said["zones"]]
    assert signs.colours == [picture.SENSING, picture.COMMUNICATION]


def test_only_undiscovered_zones_are_grey() -> None:
    said = message()
    signs = picture.undiscovered(said)
    assert signs.positions[:, :2].tolist() == [[5.2, 2.2]]
    assert signs.colours == [picture.UNDISCOVERED]
    said["truth"] = None
    assert picture.undiscovered(said).colours == []


def test_a_target_nobody_has_seen_is_not_drawn() -> None:
    said = message()
    said["targets"][0]["position"] = None
    assert len(picture.targets(said).colours) == 5
    assert len(picture.uncertainties(said).colours) == 5
    assert "t121" not in picture.labels(said)
    assert len(picture.assignment_lines(said).points) == 5


def test_an_empty_team_is_an_empty_picture() -> None:
    said = message() | {"robots": [], "targets": [], "zones": [], "truth": None}
    for draw in (picture.robots, picture.targets, picture.zones, picture.uncertainties):
        assert draw(said).colours == []
    assert picture.assignment_lines(said).points.shape == (0, 2, 3)


def test_labels_are_left_out_where_there_are_too_many() -> None:
    said = message()
    assert picture.labels(said)["r26"][0] == "D26 blind"
    robot = said["robots"][0]
    said["robots"] = [robot | {"id": number} for number in range(200)]
    assert picture.labels(said) == {}


def test_the_grid_covers_the_field_in_round_steps() -> None:
    grid = picture.field_grid(message())
    xs = np.unique(grid.points[..., 0])
    assert (xs.min(), xs.max()) == (-8.0, 8.0)
    steps = np.diff(xs)
    assert steps == pytest.approx(np.full(len(steps), 2.0))


def test_trails_are_bounded_and_begin_anew_when_time_goes_back() -> None:
    trails = Trails()
    for tick in range(400):
        trails.note(message(0.1 * tick))
    lines = trails.lines()
    assert 4 * 20 < len(lines.points) <= 4 * 29
    last = {tuple(line[1]) for line in lines.points.tolist()}
    assert tuple(message(39.6)["robots"][0]["position"]) in last
    trails.note(message(0.0))
    assert len(trails.lines().points) == 0
