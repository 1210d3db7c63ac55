"""What robots are told to fly on alone, and whose turn it is."""

from dataclasses import replace

import pytest

from server.mission.core import MissionCore
from server.mission.downlink import KNOWLEDGE_TICKS, MOST_IN_A_TICK, Briefing, Turns
from server.mission.setup import HazardSetup
from solver.observations import Link, LinkChange
from solver.snapshot import Snapshot
from solver.zones import ZoneKind
from tests.server.builders import mission_setup, straight_solution

CROWD = tuple(range(1, 201))


@pytest.fixture(name="core")
def _core() -> MissionCore:
    core = MissionCore(mission_setup(robots=4, targets=4))
    core.commit(straight_solution(core.begin(0.0)))
    return core


def at(snapshot: Snapshot, tick: int) -> Snapshot:
    return replace(snapshot, tick=tick)


def test_each_is_told_its_own_targets_limits_and_mates(core: MissionCore) -> None:
    briefing = Briefing(core)
    for robot in core.setup.robots:
        known = briefing.of(robot.id)
        assert known.targets == core.directives.targets_of(robot.id)
        assert [track.target_id for track in known.tracks] == list(known.targets)
        assert known.rules.control_upper == robot.control_upper
        assert [mate.robot_id for mate in known.mates] == [
            other.id for other in core.setup.robots if other.id != robot.id
        ]
    with pytest.raises(KeyError):
        briefing.of(99)


def test_how_zones_are_inferred_is_told_where_nothing_reveals_them() -> None:
    revealed = MissionCore(mission_setup())
    assert Briefing(revealed).of(21).rules.inference is None
    hidden = replace(revealed.setup, hazards=HazardSetup(recover_density=0.08, memory_s=300.0))
    told = Briefing(MissionCore(hidden)).of(21).rules.inference
    assert told is not None
    assert (told.memory_s, told.law.recover_density) == (300.0, 0.08)
    assert told.law.period_s == hidden.planner.attack_period_s
    assert told.risk_single == hidden.zone_defaults(ZoneKind.COMMUNICATION).risk_single


def test_the_lost_are_no_mates_and_are_told_of_those_who_are_left(core: MissionCore) -> None:
    core.observe(LinkChange(22, Link.LOST, "gone"))
    core.commit(straight_solution(core.begin(0.1)))
    briefing = Briefing(core)
    assert 22 not in [mate.robot_id for mate in briefing.of(21).mates]
    assert [mate.robot_id for mate in briefing.of(22).mates] == [
        robot.id for robot in core.setup.robots if robot.id != 22
    ]


def test_a_small_team_is_told_at_once_on_a_change_else_in_turn(core: MissionCore) -> None:
    turns, snapshot = Turns(CROWD[:50]), core.snapshot
    assert turns.take(at(snapshot, 0)) == CROWD[:50]
    told = [turns.take(at(snapshot, tick)) for tick in range(1, 1 + KNOWLEDGE_TICKS)]
    assert sorted(i for some in told for i in some) == list(CROWD[:50])
    assert max(map(len, told)) == 5
    changed = replace(snapshot, directives=replace(snapshot.directives, capacities=()))
    assert turns.take(at(changed, 20)) == CROWD[:50]


def test_a_large_team_is_told_over_a_few_ticks_whoever_waits_longest_first(
    core: MissionCore,
) -> None:
    turns, snapshot = Turns(CROWD), core.snapshot
    other = replace(snapshot, directives=replace(snapshot.directives, capacities=()))
    told: set[int] = set()
    for tick in range(8):
        # Something changes at every tick, which must not put anybody off for ever.
        some = turns.take(at(other if tick % 2 else snapshot, tick))
        assert len(some) <= MOST_IN_A_TICK
        told.update(some)
    assert told == set(CROWD)
