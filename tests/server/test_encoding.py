import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from server.encoding import (
    EventKind,
    MissionState,
    Severity,
    event_message,
    keep_out_axes_m,
    snapshot_message,
    truth_object,
)
from server.loops import LoopReport
from solver.arrays import frozen
from solver.directives import CommentVerdict, Pairing, Pin
from solver.observations import Comment, Link
from solver.snapshot import CommentReceipt, Snapshot
from solver.zones import Zone, ZoneKind
from tests.server.scripted import (
    FIELD,
    LOWER,
    UPPER,
    ZONE_DEFAULTS,
    directives,
    loop_reports,
    snapshot,
)


def message(picture: Snapshot | None = None, **changes: Any) -> dict[str, Any]:
    arguments: dict[str, Any] = {
        "state": MissionState.RUNNING,
        "loops": loop_reports(30.0),
        "field": FIELD,
        "weight_bounds": (LOWER, UPPER),
        "severity_bounds": (1.0, 5.0),
        "zone_defaults": ZONE_DEFAULTS,
        "attacks": {ZoneKind.SENSING: 3},
        "mission": "m1",
    } | changes
    return snapshot_message(snapshot(30.0) if picture is None else picture, **arguments)


def test_a_message_has_every_key_of_the_contract() -> None:
    said = message()
    assert list(said) == [
        "type", "v", "mission", "tick", "time_s", "state", "field", "robots", "targets", "zones",
        "zone_defaults", "directives", "solve", "trace", "guidance", "loops", "attacks", "comments",
        "truth", "stamp_s",
    ]  # fmt: skip
    assert said["type"] == "snapshot"
    assert said["v"] == 1
    assert said["state"] == "running"
    assert said["time_s"] == 30.0
    assert said["truth"] is None
    assert said["stamp_s"] is None
    assert message(stamp_s=12.34567)["stamp_s"] == 12.3457


def test_a_message_is_plain_json_without_nan() -> None:
    text = json.dumps(message(), allow_nan=False)
    assert json.loads(text) == message()


def test_robots_carry_place_link_and_command() -> None:
    picture = snapshot(30.0)
    robot = message(picture)["robots"][1]
    x, y = picture.robots.positions[1]
    assert robot == {
        "id": 26,
        "position": [pytest.approx(x, abs=1e-3), pytest.approx(y, abs=1e-3), 1.4],
        "velocity": pytest.approx(picture.robots.velocities[1].tolist(), abs=1e-3),
        "link": "connected",
        "sensing_failed": True,
        "setpoint": [0.21, 0.21],
        "waypoint": [pytest.approx(x + 0.35, abs=1e-3), pytest.approx(y + 0.35, abs=1e-3), 1.4],
        "state_age_s": 0.05,
    }


def test_a_robot_never_heard_of_has_no_age() -> None:
    assert message()["robots"][3]["state_age_s"] is None


def test_a_target_nobody_has_seen_has_no_place() -> None:
    picture = snapshot(0.0)
    positions = picture.tracks.positions.copy()
    positions[2] = math.nan
    unseen = replace(picture.tracks, positions=frozen(positions))
    target = message(replace(picture, tracks=unseen))["targets"][2]
    assert target["position"] is None
    assert target["covariance"] is not None


def test_directives_name_every_robot_even_without_targets() -> None:
    picture = snapshot(0.0, directives=directives(frozenset({Pairing(21, 122), Pairing(21, 121)})))
    said = message(picture)["directives"]
    assert said["assignment"] == {"21": [121, 122], "26": [], "31": [], "34": []}
    assert said["weights"] == {
        "tracking": 10.0, "control": 0.05, "sensing": 50.0, "communication": 50.0
    }  # fmt: skip
    assert said["weight_bounds"]["control"] == [0.005, 0.5]
    assert said["severity_bounds"] == [1.0, 5.0]
    assert said["capacities"]["34"] == 2


def test_pins_tell_their_comment_and_end() -> None:
    pin = Pin("p1", Pairing(21, 122), 150.0, "c1")
    said = message(snapshot(0.0, directives=directives(pins=(pin,))))["directives"]["pins"]
    assert said == [
        {"id": "p1", "robot": 21, "target": 122, "expires_s": 150.0, "comment": "c1",
         "forbids": False}
    ]  # fmt: skip


def test_zones_tell_who_knows_them() -> None:
    said = message()["zones"]
    assert said[0]["known_by"] == [21, 26, 31, 34]
    assert said[1]["known_by"] == [21, 31, 34]
    assert said[1]["kind"] == "communication"


def test_keep_out_of_a_sensing_zone_is_quantile_times_deviation_plus_margin() -> None:
    zone = Zone("z", ZoneKind.SENSING, (0, 0), ((0.25, 0.0), (0.0, 0.09)), 0.2, 0.1)
    standard_normal_90 = 1.2815515655446004  # from a table: P(Z < 1.28155) = 0.9
    expected = (standard_normal_90 * 0.5 + 0.2, standard_normal_90 * 0.3 + 0.2)
    assert keep_out_axes_m(zone, 1.0, 7.0) == pytest.approx(expected)


def test_keep_out_grows_with_the_root_of_the_severity() -> None:
    zone = Zone("z", ZoneKind.SENSING, (0, 0), ((1.0, 0.0), (0.0, 1.0)), 0.0, 0.1)
    fourfold, once = keep_out_axes_m(zone, 4.0, 0.0), keep_out_axes_m(zone, 1.0, 0.0)
    assert fourfold == pytest.approx((2.0 * once[0], 2.0 * once[1]))


def test_keep_out_of_a_communication_zone_grows_with_the_connected_team() -> None:
    picture = snapshot(0.0)
    far = np.array([[0.0, 0.0], [3.0, 4.0], [90.0, 0.0], [0.0, 1.0]])  # the third is jammed
    robots = replace(picture.robots, positions=frozen(far))
    assert picture.robots.links[2] is Link.JAMMED
    zone = picture.zones[1]
    said = message(replace(picture, robots=robots))["zones"][1]["keep_out_m"]
    assert said == pytest.approx(zone.quantile() * math.sqrt(0.6) + 0.2 * 5.0, abs=1e-3)


def test_loops_without_a_call_have_no_rate() -> None:
    said = message(loops={"task_llm": LoopReport(0, 0, None, None, None, None)})["loops"]
    assert said == {
        "task_llm": {"rate_hz": None, "mean_s": None, "success_rate": None, "age_s": None,
                     "adopted_rate": None, "waits_for_person": False,
                     "calls": 0, "missed": 0}
    }  # fmt: skip


def test_attacks_of_both_kinds_are_counted() -> None:
    assert message()["attacks"] == {"sensing": 3, "communication": 0}


def test_comments_tell_each_loops_answer() -> None:
    comment = Comment("c1", "Focus on 122.", 3.0, 120.0)
    receipt = CommentReceipt(
        comment,
        task=CommentVerdict.APPLIED,
        task_reason="swapped",
        task_feedback="As you wish.",
        task_proposal="t4",
    )
    assert message(snapshot(3.0, receipts=(receipt,)))["comments"] == [
        {
            "id": "c1",
            "text": "Focus on 122.",
            "author": "operator",
            "time_s": 3.0,
            "expires_s": 123.0,
            "status": "applied",
            "task": {
                "verdict": "applied",
                "reason": "swapped",
                "feedback": "As you wish.",
                "proposal": "t4",
            },
            "action": None,
        }
    ]


def test_truth_carries_zones_nobody_has_found() -> None:
    zone = Zone("s9", ZoneKind.SENSING, (1.0, 2.0), ((1.0, 0.0), (0.0, 1.0)), 0.1, 0.1)
    assert truth_object({21: (1.0, 2.0)}, {122: (0.12345, 0.0)}, (zone,)) == {
        "robots": [{"id": 21, "position": [1.0, 2.0]}],
        "targets": [{"id": 122, "position": [0.123, 0.0]}],
        "zones": [
            {"id": "s9", "kind": "sensing", "mean": [1.0, 2.0],
             "covariance": [[1.0, 0.0], [0.0, 1.0]]}
        ],
    }  # fmt: skip


def test_an_event_says_what_happened_in_words() -> None:
    said = event_message(
        "m1", 17, 3.14159, EventKind.ATTACK, Severity.WARNING, "Zone s1 blinded robot 21.",
        {"robot": 21},
    )  # fmt: skip
    assert said == {
        "type": "event",
        "v": 1,
        "mission": "m1",
        "seq": 17,
        "time_s": 3.142,
        "kind": "attack",
        "severity": "warning",
        "text": "Zone s1 blinded robot 21.",
        "data": {"robot": 21},
    }
