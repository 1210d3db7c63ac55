"""What is said is what arrives."""

import math
from dataclasses import replace
from typing import Any

import pytest

from solver.observations import Detections, RobotState, Sighting, TrackReport
from solver.setpoints import Setpoint
from solver.streams import Streams
from solver.zones import ZoneKind
from tests.vehicles.pilots import INFERENCE, JAMMING, SENSING, knowledge, track, with_rules
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles import messages as wire
from vehicles import translation
from vehicles.knowledge import Mate
from vehicles.world.setup import WorldTarget
from vehicles.world.world import World

HEADER: dict[str, Any] = {"v": 1, "boot": "b1", "seq": 0, "stamp_s": 2.0}


def over_the_wire(message: wire.MessageT) -> wire.MessageT:
    return wire.decode(type(message), wire.encode(message))


def test_a_sender_counts_every_key_by_itself() -> None:
    sender = translation.Sender("b1")
    seqs = [sender.header(key, 1.0)["seq"] for key in ("a", "a", "b", "a")]
    assert seqs == [0, 1, 0, 2]
    assert sender.header("b", 7.5) == {"v": 1, "boot": "b1", "seq": 1, "stamp_s": 7.5}


def test_states() -> None:
    state = RobotState(21, (1.0, -2.0), (0.1, 0.2), 1.5, True)
    sent = translation.state_message(HEADER, state, wire.Mode.ONBOARD)
    assert translation.state_of(over_the_wire(sent)) == state
    assert sent.mode is wire.Mode.ONBOARD


@pytest.mark.parametrize("bearing", [math.pi, -math.pi, 0.3])
def test_detections(bearing: float) -> None:
    seen = Detections(21, (1.0, 2.0), (Sighting(122, 3.0, bearing),))
    sent = translation.detections_message(HEADER, seen)
    assert translation.detections_of(over_the_wire(sent)) == seen


def test_setpoints() -> None:
    setpoint = Setpoint(21, (0.1, 0.2), (3.0, 4.0), 1.5, 0.5)
    sent = translation.setpoint_message(HEADER, setpoint, "m1")
    assert translation.setpoint_of(over_the_wire(sent)) == setpoint


def test_events() -> None:
    for revealed in (SENSING, None):
        part = translation.attack_part(ZoneKind.SENSING, revealed)
        sent = wire.Event(**HEADER, robot_id=21, age_s=0.5, event=part)
        arrived = over_the_wire(sent).event
        assert isinstance(arrived, wire.AttackPart)
        attack = translation.attack_of(21, arrived, 9.5)
        assert (attack.robot_id, attack.kind, attack.time_s) == (21, ZoneKind.SENSING, 9.5)
        assert attack.zone == revealed
    report = TrackReport(21, (track(122, 1.0, 2.0),), (SENSING, JAMMING), ((0.5, 1.0), (0.7, 1.0)))
    back = over_the_wire(
        wire.Event(**HEADER, robot_id=21, age_s=0.0, event=translation.return_part(report))
    ).event
    assert isinstance(back, wire.ReturnPart)
    assert translation.report_of(21, back) == report


def test_a_mate_is_made_once_for_all_that_are_told_of_it() -> None:
    parts = translation.MateParts()
    mates = (Mate(1, (0.5, 1.0)), Mate(2, (2.0, 3.0)))
    made = parts.of(mates)
    assert [(part.robot_id, part.position) for part in made] == [(1, (0.5, 1.0)), (2, (2.0, 3.0))]
    assert parts.of(mates[1:])[0] is made[1]
    assert parts.of((Mate(1, (9.0, 9.0)),))[0].position == (9.0, 9.0), "another place"


def test_knowledge_is_dated_by_the_receivers_clock() -> None:
    known = knowledge(time_s=3.0)
    arrived = over_the_wire(translation.knowledge_message(HEADER, known, translation.MateParts()))
    received = translation.knowledge_of(arrived, 1234.5)
    assert received.time_s == 1234.5
    # The sensor compares by identity, so the rest is compared without it.
    sensor = known.rules.sensor
    same = replace(received, time_s=3.0, rules=replace(received.rules, sensor=sensor))
    assert same == known
    assert received.rules.sensor.range_peak == sensor.range_peak
    assert received.rules.sensor.bearing_shape == sensor.bearing_shape


def test_how_a_robot_infers_zones_is_told_with_its_rules() -> None:
    known = with_rules(knowledge(), inference=INFERENCE)
    arrived = over_the_wire(translation.knowledge_message(HEADER, known, translation.MateParts()))
    assert translation.knowledge_of(arrived, 3.0).rules.inference == INFERENCE


def test_the_truth() -> None:
    setup = world_setup(
        (robot(21, 0.0),), (WorldTarget(122, (1.0, 2.0)),), (zone("s1", ZoneKind.SENSING),)
    )
    world = World(setup, Streams(0))
    world.attack(1e9)
    world.move(0.1, {21: (0.5, 0.0)})
    hits = wire.HitsPart(sensing=1, communication=0)
    sent = over_the_wire(
        translation.truth_message(HEADER, world.truth(), wire.WorldState.RUNNING, hits)
    )
    assert sent.robots[0].position == (0.05, 0.0)
    assert sent.robots[0].sensing_failed
    assert not sent.robots[0].jammed
    assert sent.targets[0].position == (1.0, 2.0)
    assert translation.zone_of(sent.zones[0]) == setup.zones[0].zone
    assert (sent.time_s, sent.step) == (0.1, 1)
