"""What the mission infers of zones that nothing reveals: names, knowledge, severities, people."""

from dataclasses import replace

import numpy as np
import pytest

from server.mission.checkpoint import checkpoint_text, read_checkpoint
from server.mission.core import MissionCore
from server.mission.downlink import Briefing
from server.mission.setup import HazardSetup, MissionSetup
from solver.directives import Proposal, Source
from solver.observations import (
    Attack,
    Link,
    LinkChange,
    RobotState,
    TrackReport,
    ZoneDrawn,
    ZoneErased,
)
from solver.snapshot import Snapshot
from solver.zones import Point, ZoneKind
from tests.server.builders import mission_setup, sensing_zone, straight_solution

HIT = (1.0, 1.0)
ELSEWHERE = (-8.0, -8.0)


def inferring() -> MissionSetup:
    return replace(mission_setup(), hazards=HazardSetup(recover_density=0.05))


def state(robot_id: int, place: Point, *, blind: bool = False) -> RobotState:
    return RobotState(robot_id, place, (0.0, 0.0), 1.0, sensing_failed=blind)


class Flight:
    """A core whose robots are where they are told to be."""

    def __init__(self, core: MissionCore) -> None:
        self.core = core
        self.now_s = core.snapshot.time_s

    def tick(self, places: dict[int, Point], blind: tuple[int, ...] = ()) -> Snapshot:
        for robot_id, place in places.items():
            self.core.observe(state(robot_id, place, blind=robot_id in blind))
        self.now_s = round(self.now_s + 0.1, 6)
        self.core.commit(straight_solution(self.core.begin(self.now_s)))
        return self.core.snapshot

    def blinded(self, times: int = 1) -> Snapshot:
        """Let robot 21 be blinded in one place, some times."""
        for _ in range(times):
            self.core.observe(Attack(21, ZoneKind.SENSING, None, self.now_s + 0.1))
            self.tick({21: HIT, 22: ELSEWHERE}, blind=(21,))
        for _ in range(20):
            self.tick({21: ELSEWHERE, 22: ELSEWHERE})
        return self.core.snapshot


def test_a_hit_makes_a_zone_known_that_the_optimizer_keeps_out_of() -> None:
    flight = Flight(MissionCore(inferring()))
    snapshot = flight.blinded()
    (zone,), (inferred,) = snapshot.zones, snapshot.inferred
    assert (zone.id, zone.kind, inferred.zone_id) == ("i1", ZoneKind.SENSING, "i1")
    assert np.hypot(*(np.asarray(zone.mean) - HIT)) < 0.5
    assert 0.5 <= inferred.confidence <= 1.0
    assert np.asarray(zone.covariance) == pytest.approx(
        np.asarray(inferred.extent) + np.asarray(inferred.centre_covariance)
    )
    assert (zone.margin, zone.risk) == (0.1, 0.1)
    assert snapshot.known.all()
    problem = flight.core.problem_under(flight.core.directives)
    assert problem.sensing.centres[0] == pytest.approx(zone.mean)
    assert Briefing(flight.core).of(22).zones == (zone,)


def test_nothing_is_inferred_where_zones_are_revealed() -> None:
    flight = Flight(MissionCore(mission_setup()))
    snapshot = flight.blinded(3)
    assert (snapshot.zones, snapshot.inferred, flight.core.checkpoint().hazards) == ((), (), ())


def test_a_robot_that_falls_silent_was_hit_where_it_was_last() -> None:
    flight = Flight(MissionCore(inferring()))
    flight.tick({21: HIT, 22: ELSEWHERE})
    flight.core.observe(LinkChange(21, Link.JAMMED, "silent"))
    flight.tick({22: ELSEWHERE})
    for _ in range(3):
        flight.tick({22: ELSEWHERE})
    snapshot = flight.core.snapshot
    (zone,) = snapshot.zones
    assert zone.kind is ZoneKind.COMMUNICATION
    assert np.hypot(*(np.asarray(zone.mean) - HIT)) < 0.5
    assert snapshot.known[:, 0].tolist() == [False, True], "nobody can tell the silent one"
    flight.core.observe(LinkChange(21, Link.CONNECTED, "heard"))
    for age_s in (0.1, 2.0):
        flight.core.observe(Attack(21, ZoneKind.COMMUNICATION, None, flight.now_s - age_s))
    flight.core.observe(TrackReport(21, (), ()))
    snapshot = flight.tick({21: ELSEWHERE, 22: ELSEWHERE})
    assert snapshot.known.all()
    for _ in range(20):
        snapshot = flight.tick({21: ELSEWHERE, 22: ELSEWHERE})
    assert [zone.id for zone in snapshot.zones] == ["i1"], "what it tells late is no second hit"


def back_from(silent: tuple[Point, ...]) -> Snapshot:
    """What is known after robot 21 was cut off in one place and says where it was not heard."""
    flight = Flight(MissionCore(inferring()))
    for x in range(8):
        flight.tick({21: (HIT[0] - 0.8 + 0.1 * x, HIT[1]), 22: ELSEWHERE})
    flight.core.observe(LinkChange(21, Link.JAMMED, "silent"))
    for _ in range(4):
        flight.tick({22: ELSEWHERE})
    flight.core.observe(LinkChange(21, Link.CONNECTED, "heard"))
    flight.core.observe(TrackReport(21, (), (), silent))
    snapshot = flight.core.snapshot
    for _ in range(20):
        snapshot = flight.tick({21: ELSEWHERE, 22: ELSEWHERE})
    return snapshot


def test_where_a_robot_was_not_heard_tells_where_the_zone_lies() -> None:
    (vague,) = back_from(()).zones
    north = tuple((HIT[0], HIT[1] + 0.2 * step) for step in range(8))
    (zone,) = back_from(north).zones
    assert zone.mean[1] > vague.mean[1] + 0.3
    beyond = ((1e7, -1e7), (HIT[0], HIT[1] + 0.4))
    assert len(back_from(beyond).zones) == 1, "a place nobody can have been breaks nothing"


def test_a_lost_robot_and_late_word_tell_nothing() -> None:
    flight = Flight(MissionCore(inferring()))
    flight.tick({21: HIT, 22: ELSEWHERE})
    flight.core.observe(LinkChange(21, Link.LOST, "gone"))
    flight.core.observe(Attack(22, ZoneKind.SENSING, None, flight.now_s - 3.0))
    flight.core.observe(Attack(99, ZoneKind.SENSING, None, flight.now_s))
    for _ in range(5):
        flight.tick({22: ELSEWHERE})
    assert flight.core.snapshot.zones == ()


def test_a_zone_that_is_refuted_goes_and_its_severity_with_it() -> None:
    flight = Flight(MissionCore(inferring()))
    flight.blinded()
    wish = Proposal("p", Source.OPERATOR, flight.now_s, severities=(("i1", 2.0),))
    assert flight.core.propose(wish).accepted
    assert flight.core.current.directives.severity_of("i1") == 2.0
    steps = 0
    while flight.core.snapshot.zones and steps < 3000:
        around = 0.8 * np.array([np.cos(0.1 * steps), np.sin(0.1 * steps)])
        near = (HIT[0] + float(around[0]), HIT[1] + float(around[1]))
        flight.tick({21: HIT, 22: near})
        steps += 1
    assert flight.core.snapshot.zones == ()
    assert flight.core.snapshot.inferred == ()
    assert flight.core.directives.severities == ()


def test_what_people_erase_or_change_is_theirs() -> None:
    flight = Flight(MissionCore(inferring()))
    (zone,) = flight.blinded(2).zones
    flight.core.observe(ZoneErased("i1"))
    assert flight.tick({21: ELSEWHERE}).zones == ()
    for _ in range(20):
        assert flight.tick({21: ELSEWHERE}).zones == ()
    (again,) = flight.blinded().zones
    assert again.id == "i2", "it hits again, and is another one"
    flight.core.observe(ZoneDrawn(replace(again, margin=0.5)))
    snapshot = flight.tick({21: ELSEWHERE})
    assert ([z.margin for z in snapshot.zones], snapshot.inferred) == ([0.5], ())
    snapshot = flight.blinded()
    assert [z.id for z in snapshot.zones] == ["i2"], "what it does is explained"
    assert zone.id not in {z.id for z in snapshot.zones}


def test_a_drawn_zone_stands_beside_and_explains_its_hits() -> None:
    flight = Flight(MissionCore(inferring()))
    flight.core.observe(ZoneDrawn(sensing_zone("h1", HIT)))
    flight.tick({21: HIT, 22: ELSEWHERE})
    snapshot = flight.blinded(2)
    assert [zone.id for zone in snapshot.zones] == ["h1"]
    assert snapshot.inferred == ()


def test_a_returning_robot_does_not_bring_old_beliefs_back() -> None:
    flight = Flight(MissionCore(inferring()))
    (zone,) = flight.blinded().zones
    old = replace(zone, mean=(7.0, 7.0))
    flight.core.observe(TrackReport(22, (), (old, replace(old, id="i9"), sensing_zone("s1"))))
    snapshot = flight.tick({21: ELSEWHERE, 22: ELSEWHERE})
    assert {z.id: z.mean for z in snapshot.zones} == {"i1": zone.mean, "s1": (0.0, 0.0)}


def test_a_checkpoint_carries_the_beliefs_into_another_core() -> None:
    flight = Flight(MissionCore(inferring()))
    before = flight.blinded(2)
    kept = read_checkpoint(checkpoint_text(flight.core.checkpoint()))
    core = MissionCore(replace(inferring(), start=kept))
    assert [z.id for z in core.snapshot.zones] == ["i1"]
    (then,), (now,) = before.inferred, core.snapshot.inferred
    assert now.confidence == pytest.approx(then.confidence, abs=0.05)
    assert now.since_s == then.since_s
    after = Flight(core)
    snapshot = after.blinded()
    assert [z.id for z in snapshot.zones] == ["i1"], "the same place is the same zone"
    assert np.hypot(*(np.asarray(snapshot.zones[0].mean) - HIT)) < 0.5
