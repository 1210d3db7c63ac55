from typing import Any

import numpy as np
import pytest

from console import picture
from console.clouds import SHELLS
from console.picture import Trails
from solver.directives import Pairing, Pin
from tests.console.messages import message
from tests.server.scripted import directives


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


def inferred(said: dict[str, Any], confidence: float) -> dict[str, Any]:
    """Return a message in which the first zone is inferred."""
    told, *others = said["zones"]
    known = {"extent": told["covariance"], "centre_covariance": [[0.3, 0.0], [0.0, 0.34]]}
    found = {"origin": "inferred", "confidence": confidence, "inferred": known | {"since_s": 9.0}}
    return said | {"zones": [told | found, *others]}


def test_an_inferred_zone_is_a_cloud_and_no_disc() -> None:
    said = inferred(message(), 0.72)
    solid, cloud = picture.zones(said), picture.clouds(said)
    assert solid.colours == [picture.COMMUNICATION]
    assert picture.clouds(message()).colours == []
    assert set(cloud.colours) == {picture.SENSING}
    assert len(cloud.positions) == len(cloud.scales) == len(cloud.opacities or ()) == SHELLS
    axes = np.array(said["zones"][0]["keep_out_axes_m"])
    shares = cloud.scales[:, :2] / axes
    assert shares[:, 0] == pytest.approx(shares[:, 1])
    assert (np.diff(shares[:, 0]) < 0.0).all(), "its edge is soft: each disc smaller"
    assert shares[0, 0] > 1.0 > shares[-1, 0]
    assert len(np.unique(cloud.positions[:, 2])) == SHELLS, "none lies in another"


def test_a_cloud_is_the_denser_the_surer() -> None:
    thin, thick = (picture.clouds(inferred(message(), sure)).opacities for sure in (0.3, 0.9))
    assert thin is not None
    assert thick is not None
    assert np.array(thick) == pytest.approx(3.0 * np.array(thin))
    middle = 1.0 - np.prod(1.0 - np.array(thick))
    assert 0.3 < middle < 0.7


def test_an_inferred_zone_tells_how_sure_it_is_and_hides_no_true_one() -> None:
    said = inferred(message(), 0.72)
    names = {label.key: label.text for label in picture.labels(said)}
    assert names["zs1"] == "s1 72 %"
    assert names["zc1"] == "c1"
    assert len(picture.undiscovered(said).colours) == 2
    certain = inferred(message(), 0.9999)
    assert "s1 99 %" in [label.text for label in picture.labels(certain)]


def test_a_target_nobody_has_seen_is_not_drawn() -> None:
    said = message()
    said["targets"][0]["position"] = None
    assert len(picture.targets(said).colours) == 5
    assert len(picture.uncertainties(said).colours) == 5
    assert "t121" not in [label.key for label in picture.labels(said)]
    assert len(picture.assignment_lines(said).points) == 5


def test_an_empty_team_is_an_empty_picture() -> None:
    said = message() | {"robots": [], "targets": [], "zones": [], "truth": None}
    for draw in (picture.robots, picture.targets, picture.zones, picture.uncertainties):
        assert draw(said).colours == []
    assert picture.assignment_lines(said).points.shape == (0, 2, 3)


def test_names_tell_states_and_the_ill_choose_their_place_first() -> None:
    found = {label.key: label for label in picture.labels(message())}
    assert found["r26"].text == "D26 blind"
    assert found["r26"].rank < found["r21"].rank < found["t121"].rank < found["zs1"].rank
    assert found["r21"].place == tuple(message()["robots"][0]["position"])


def test_pins_are_lines_of_their_own_with_a_mark() -> None:
    pins = (Pin("a", Pairing(21, 125), None), Pin("b", Pairing(34, 124), None, None, forbids=True))
    said = message(directives=directives(pins=pins))
    pinned, others = picture.pinned_lines(said), picture.assignment_lines(said)
    assert (len(pinned.points), len(others.points)) == (1, 5)
    assert pinned.points[0, 0].tolist() == said["robots"][0]["position"]
    assert picture.pins(said).positions.tolist() == [pinned.points[0].mean(axis=0).tolist()]


def test_a_pin_that_is_not_assigned_has_no_line() -> None:
    said = message(directives=directives(pins=(Pin("a", Pairing(21, 126), None),)))
    assert len(picture.pinned_lines(said).points) == 0


def test_predicted_paths_lead_where_targets_go() -> None:
    said = message()
    assert len(picture.predicted_paths(said).points) == 0  # they stand still
    said["targets"][2]["velocity"] = [0.5, 0.0]
    said["targets"][3] |= {"velocity": None}
    paths = picture.predicted_paths(said)
    x, y = said["targets"][2]["position"]
    assert paths.points.shape == (picture.DASHES, 2, 3)
    assert paths.points[-1, 1, :2].tolist() == pytest.approx([x + 0.5 * picture.AHEAD_S, y])
    assert len(paths.colours) == picture.DASHES


def test_way_points_are_joined_with_the_robots_that_fly_to_them() -> None:
    said = message()
    lines = picture.waypoint_lines(said)
    flown = [robot for robot in said["robots"] if robot["link"] == "connected"]
    assert lines.points.tolist() == [[r["position"], r["waypoint"]] for r in flown]
    assert len(picture.waypoints(said).colours) == len(flown)


def test_the_middle_of_the_team_is_of_those_whose_place_is_known() -> None:
    said = message()
    said["robots"] = said["robots"][:2]
    said["robots"][0]["position"], said["robots"][1]["position"] = [1.0, 2.0, 1.0], None
    assert picture.team_centre(said) == (1.0, 2.0)
    said["robots"] = []
    assert picture.team_centre(said) is None


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
