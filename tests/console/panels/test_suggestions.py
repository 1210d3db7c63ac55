"""Sentences to tap: about what is there, and about what may make sense."""

import re
from math import dist
from typing import Any

from console.panels.suggestions import MOST, OFFERED_S, Offers, suggestions
from tests.console.messages import message

PAIR = re.compile(r"The Drone (\d+) should focus on tracking target (\d+)\.")


def team(**changes: Any) -> dict[str, Any]:
    """Two fit robots of two targets each at most, far from the only zone; each has one target."""
    said = message()
    robots = [r | {"velocity": [1.0, 0.0], "sensing_failed": False} for r in said["robots"][:2]]
    targets = [t | {"status": "tracked"} for t in said["targets"][:2]]
    said |= {
        "robots": [
            robots[0] | {"id": 1, "position": [0.0, 0.0, 1.0], "link": "connected"},
            robots[1] | {"id": 2, "position": [10.0, 0.0, 1.0], "link": "connected"},
        ],
        "targets": [
            targets[0] | {"id": 7, "position": [1.0, 0.0]},
            targets[1] | {"id": 8, "position": [9.0, 0.0]},
        ],
        "zones": [],
    }
    said["directives"] |= {
        "assignment": {"1": [7], "2": [8]},
        "capacities": {"1": 1, "2": 1},
        "pins": [],
    }
    return said | changes


def pair(said: dict[str, Any]) -> tuple[int, int] | None:
    """The pair that is suggested."""
    found = PAIR.fullmatch(suggestions(said)[0])
    return None if found is None else (int(found[1]), int(found[2]))


def test_nothing_is_suggested_before_there_is_a_team() -> None:
    assert suggestions(None) == []
    assert suggestions(team(robots=[])) == []
    assert suggestions(team(targets=[])) == []


def test_no_pair_is_suggested_that_would_only_lengthen_the_way() -> None:
    assert pair(team()) is None


def test_a_robot_that_is_nearer_is_suggested_for_anothers_target() -> None:
    said = team()
    said["targets"][1]["position"] = [2.0, 0.0]
    assert pair(said) == (1, 8)


def test_a_robot_with_room_for_one_more_target_comes_first() -> None:
    said = team()
    said["directives"]["capacities"]["2"] = 2
    assert pair(said) == (2, 7)


def test_who_is_hit_is_not_asked_and_targets_in_zones_are_left_alone() -> None:
    said = team()
    said["targets"][1]["position"] = [2.0, 0.0]
    blind = said | {"robots": [said["robots"][0] | {"sensing_failed": True}, said["robots"][1]]}
    assert pair(blind) is None
    zone = message()["zones"][0] | {"id": "s9", "mean": [2.0, 0.0], "keep_out_m": 0.5}
    assert pair(said | {"zones": [zone]}) is None


def test_a_pair_that_a_person_forbade_is_not_suggested() -> None:
    said = team()
    said["targets"][1]["position"] = [2.0, 0.0]
    said["directives"]["pins"] = [{"robot": 1, "target": 8, "forbids": True}]
    assert pair(said) is None


def test_caution_names_the_known_zone_that_is_nearest() -> None:
    zone = message()["zones"][0]
    zones = [
        zone | {"id": "s1", "mean": [50.0, 0.0]},
        zone | {"id": "s2", "mean": [-4.0, 0.0]},
    ]
    assert "Avoid the region around zone s2." in suggestions(team(zones=zones))
    assert not any("zone" in sentence for sentence in suggestions(team()))


def test_boldness_is_for_a_team_that_is_well() -> None:
    bold = "The robots should be more aggressive."
    assert bold in suggestions(team())
    jammed = [robot | {"link": "jammed"} for robot in team()["robots"]]
    assert bold not in suggestions(team(robots=jammed))


def test_a_robot_that_stands_still_is_asked_about() -> None:
    said = team()
    said["robots"][1]["velocity"] = [0.0, 0.0]
    assert "Why does the Drone 2 get stuck?" in suggestions(said)
    assert not any("stuck" in sentence for sentence in suggestions(said | {"time_s": 1.0}))


def test_all_that_is_named_exists() -> None:
    for tick in range(60):
        said = message(float(tick))
        found = suggestions(said)
        assert 1 <= len(found) <= MOST
        places = {target["id"]: target["position"] for target in said["targets"]}
        for sentence in found:
            for robot, target in PAIR.findall(sentence):
                assert int(robot) in {r["id"] for r in said["robots"]}
                assert dist(places[int(target)], (0.0, 0.0)) < 1e6
            for zone in re.findall(r"zone (\w+)\.", sentence):
                assert zone in {known["id"] for known in said["zones"]}


def offered(time_s: float) -> tuple[Offers, list[str]]:
    """What is offered from a team without zones, and the sentences."""
    offers = Offers()
    assert offers.renew(team(time_s=time_s))
    return offers, offers.sentences


ZONE = [{"id": "s2", "mean": [4.0, 4.0], "keep_out_m": 1.0}]


def test_sentences_are_made_anew_after_a_while_only() -> None:
    offers, first = offered(20.0)
    assert not offers.renew(team(time_s=20.0 + OFFERED_S - 0.1, zones=ZONE))
    assert offers.sentences == first
    assert offers.renew(team(time_s=20.0 + OFFERED_S, zones=ZONE))
    assert "Avoid the region around zone s2." in offers.sentences
    assert not offers.renew(team(time_s=20.0 + 2.0 * OFFERED_S, zones=ZONE)), "they are the same"


def test_sentences_are_made_anew_once_somebody_spoke() -> None:
    offers, _ = offered(20.0)
    offers.spoken()
    assert offers.renew(team(time_s=20.1, zones=ZONE))


def test_another_mission_gets_sentences_of_its_own() -> None:
    offers, _ = offered(20.0)
    assert offers.renew(team(time_s=3.0, zones=ZONE))


def test_no_sentence_moves_under_a_finger() -> None:
    offers, first = offered(20.0)
    offers.reached_for = True
    assert not offers.renew(team(time_s=100.0, zones=ZONE))
    assert offers.sentences == first
    offers.reached_for = False
    assert offers.renew(team(time_s=100.0, zones=ZONE))


def test_nothing_is_offered_before_there_is_a_picture_and_something_as_soon_as_there_is() -> None:
    offers = Offers()
    assert not offers.renew(None)
    assert not offers.renew(team(robots=[], time_s=0.1))
    assert offers.renew(team(time_s=0.2))
