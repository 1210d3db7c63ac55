"""The mission core through its public interface: facts in, problems and setpoints out."""

import time
from dataclasses import replace

import numpy as np
import pytest

from server.mission.core import MissionCore
from solver.directives import (
    CommentAnswer,
    CommentVerdict,
    Pairing,
    Proposal,
    Source,
    Weights,
)
from solver.observations import (
    Attack,
    Comment,
    HoldChange,
    HoldState,
    Link,
    LinkChange,
    OnboardTrack,
    TrackReport,
    ZoneDrawn,
)
from solver.setpoints import Setpoint
from solver.snapshot import Guidance, TrackStatus
from solver.zones import ZoneKind
from tests.server.builders import (
    WEIGHTS,
    mission_setup,
    robot_state,
    sensing_zone,
    sighting_of,
    straight_solution,
)


def tick(core: MissionCore, now_s: float) -> None:
    core.commit(straight_solution(core.begin(now_s)))


def assignment(*rows: tuple[int, tuple[int, ...]], source: Source = Source.TASK_LLM) -> Proposal:
    return Proposal(id="p", source=source, asked_s=0.0, assignment=rows)


def test_observations_count_from_the_next_begin_on() -> None:
    core = MissionCore(mission_setup())
    first = core.begin(0.0)
    core.observe(robot_state(21, (5.0, 5.0)))
    core.commit(straight_solution(first))
    assert core.snapshot.robots.positions[0].tolist() == [-2.0, 0.0]
    second = core.begin(0.1)
    assert second.positions[0].tolist() == [5.0, 5.0]


def test_time_must_advance() -> None:
    core = MissionCore(mission_setup())
    tick(core, 0.0)
    with pytest.raises(ValueError, match="time must advance"):
        core.begin(0.0)


def test_one_setpoint_per_connected_robot_with_its_altitude_and_life_time() -> None:
    core = MissionCore(mission_setup())
    setpoints = core.commit(straight_solution(core.begin(0.0)))
    assert [s.robot_id for s in setpoints] == [21, 22]
    assert setpoints[0].velocity == (0.5, 0.0)
    assert setpoints[0].waypoint == pytest.approx((-1.95, 0.0))
    assert setpoints[1].altitude_m == 2.0
    assert setpoints[0].ttl_s == 0.5


def test_detections_shrink_the_trace_and_their_absence_lets_it_grow() -> None:
    core = MissionCore(mission_setup())
    tick(core, 0.0)
    before = core.snapshot.trace
    core.observe(sighting_of(21, (-2.0, 0.0), 121, (2.0, 0.0)))
    tick(core, 0.1)
    seen = core.snapshot.trace
    tick(core, 0.2)
    assert seen < before < core.snapshot.trace + before
    assert core.snapshot.trace > seen


def test_a_jammed_robot_is_not_planned_and_its_late_detections_do_not_count() -> None:
    core = MissionCore(mission_setup())
    tick(core, 0.0)
    core.observe(LinkChange(21, Link.JAMMED, "silent, token kept"))
    core.observe(sighting_of(21, (-2.0, 0.0), 121, (2.0, 0.0)))
    problem = core.begin(0.1)
    assert problem.robot_ids == (22,)
    assert problem.obstacles.shape == (0, 2), "nobody heard where it was"
    trace = core.snapshot.trace
    core.commit(straight_solution(problem))
    assert core.snapshot.trace > trace
    assert core.snapshot.robots.links == (Link.JAMMED, Link.CONNECTED)


def test_a_robot_out_of_reach_is_kept_clear_of_for_a_while() -> None:
    core = MissionCore(mission_setup())
    core.observe(robot_state(21, (-1.0, 0.5)))
    tick(core, 0.0)
    core.observe(LinkChange(21, Link.JAMMED, "silent"))
    assert core.begin(0.1).obstacles.tolist() == [[-1.0, 0.5]]
    core.commit(straight_solution(core.begin(9.0)))
    assert core.begin(9.1).obstacles.shape == (0, 2)


def test_a_sensing_failure_takes_the_robot_out_of_the_tracking_term() -> None:
    core = MissionCore(mission_setup())
    core.observe(robot_state(21, (-2.0, 0.0), sensing_failed=True))
    problem = core.begin(0.0)
    assert problem.sees.tolist() == [[False, False], [False, True]]


def test_an_attack_teaches_the_connected_team_the_zone() -> None:
    core = MissionCore(mission_setup())
    core.observe(LinkChange(22, Link.JAMMED, "silent"))
    core.observe(Attack(21, ZoneKind.SENSING, sensing_zone(), 0.0))
    tick(core, 0.0)
    assert core.snapshot.known.tolist() == [[True], [False]]
    assert len(core.snapshot.attacks) == 1
    core.observe(LinkChange(22, Link.CONNECTED, "back"))
    problem = core.begin(0.1)
    assert problem.sensing.known.tolist() == [[True], [True]], "the missed news is repeated"


def test_a_returning_robot_brings_zones_and_tracks_without_double_counting() -> None:
    core = MissionCore(mission_setup())
    tick(core, 0.0)
    before = core.snapshot.tracks.covariances[0].copy()
    track = OnboardTrack(121, (2.1, 0.0), tuple(map(tuple, before)))
    core.observe(TrackReport(21, (track,), (sensing_zone(),)))
    core.begin(0.1)
    fused = core.beliefs.covariances[0]
    assert np.linalg.eigvalsh(fused - before).min() > -1e-9, "same information twice is not more"
    core.commit(straight_solution(core.begin(0.2)))
    assert [zone.id for zone in core.snapshot.zones] == ["s1"]


def test_an_accepted_proposal_is_in_the_next_problem_and_a_refused_one_changes_nothing() -> None:
    core = MissionCore(mission_setup())
    tick(core, 0.0)
    assert core.propose(assignment((21, (122,)), (22, (121,)))).accepted
    assert core.begin(0.1).sees.tolist() == [[False, True], [True, False]]
    core.commit(straight_solution(core.begin(0.2)))
    verdict = core.propose(assignment((21, (122,)), (22, (122,))))
    assert not verdict.accepted
    assert core.begin(0.3).sees.tolist() == [[False, True], [True, False]]


def test_two_proposals_between_ticks_are_verified_against_what_is_in_force() -> None:
    core = MissionCore(mission_setup())
    tick(core, 0.0)
    weights = (5.0, 0.05, 100.0, 50.0)
    assert core.propose(Proposal("w", Source.ACTION_LLM, 0.0, weights=weights)).accepted
    assert core.propose(assignment((21, (122,)), (22, (121,)))).accepted
    tick(core, 0.1)
    assert core.snapshot.directives.weights == Weights(*weights)
    assert Pairing(21, 122) in core.snapshot.directives.assignment


@pytest.mark.parametrize(
    "weights",
    [
        (0.0, 0.05, 50.0, 50.0),
        (10.0, 0.05, 50.0),
        (10.0, float("nan"), 50.0, 50.0),
        (1e9, 0.05, 50.0, 50.0),
    ],
)
def test_weights_outside_the_envelope_never_reach_the_problem(weights: tuple[float, ...]) -> None:
    core = MissionCore(mission_setup())
    tick(core, 0.0)
    assert not core.propose(Proposal("w", Source.ACTION_LLM, 0.0, weights=weights)).accepted
    assert core.begin(0.1).weights == WEIGHTS


def test_hold_zeroes_every_setpoint_at_the_next_tick_and_resume_flies_on() -> None:
    core = MissionCore(mission_setup())
    tick(core, 0.0)
    core.observe(HoldChange(HoldState.HELD))
    held = core.commit(straight_solution(core.begin(0.1)))
    assert [s.velocity for s in held] == [(0.0, 0.0), (0.0, 0.0)]
    assert held[0].waypoint == (-2.0, 0.0)
    assert core.snapshot.guidance is Guidance.HOLD
    core.observe(HoldChange(HoldState.FLYING))
    flying = core.commit(straight_solution(core.begin(0.2)))
    assert flying[0].velocity == (0.5, 0.0)


def test_held_robots_keep_their_place_and_their_altitude_whatever_they_report() -> None:
    core = MissionCore(mission_setup())
    tick(core, 0.0)
    core.observe(HoldChange(HoldState.HELD))

    def held_at(now_s: float, place: tuple[float, float], altitude_m: float) -> Setpoint:
        core.observe(replace(robot_state(21, place), altitude_m=altitude_m))
        return core.commit(straight_solution(core.begin(now_s)))[0]

    first = held_at(0.1, (-1.5, 0.2), 1.0)
    assert (first.waypoint, first.altitude_m) == ((-1.5, 0.2), 1.0)
    drifted = held_at(0.2, (-1.2, 0.3), 0.8)
    assert (drifted.waypoint, drifted.altitude_m) == ((-1.5, 0.2), 1.0), "not where it drifts"
    assert held_at(0.3, (3.0, 0.2), 1.0).waypoint == (3.0, 0.2), "somebody has moved it"
    core.observe(HoldChange(HoldState.HELD))
    assert held_at(0.4, (3.3, 0.2), 1.0).waypoint == (3.3, 0.2), "held anew"


def test_a_comment_that_changed_the_assignment_pins_it_until_it_expires() -> None:
    core = MissionCore(mission_setup())
    core.observe(Comment("c1", "focus", time_s=0.0, ttl_s=5.0))
    tick(core, 0.0)
    assert core.snapshot.receipts[0].status == "received"
    answer = CommentAnswer("c1", CommentVerdict.APPLIED, "as asked")
    proposal = Proposal(
        "p",
        Source.TASK_LLM,
        0.0,
        assignment=((21, (121, 122)), (22, (122,))),
        comment_answers=(answer,),
        considered=("c1",),
    )
    assert core.propose(proposal).accepted
    tick(core, 0.1)
    assert core.snapshot.receipts[0].status == "applied"
    assert [p.pair for p in core.snapshot.directives.pins] == [Pairing(21, 122)]
    undo = assignment((21, (121,)), (22, (122,)))
    verdict = core.propose(undo)
    assert not verdict.accepted, "the comment still holds"
    tick(core, 5.0)
    assert core.snapshot.directives.pins == ()
    assert core.snapshot.receipts == ()
    assert core.snapshot.closed[0].expired
    assert core.propose(undo).accepted


def test_a_refused_answer_leaves_the_comment_open() -> None:
    core = MissionCore(mission_setup())
    core.observe(Comment("c1", "both to one", time_s=0.0, ttl_s=5.0))
    tick(core, 0.0)
    answer = CommentAnswer("c1", CommentVerdict.APPLIED, "done")
    core.propose(
        Proposal(
            "p",
            Source.TASK_LLM,
            0.0,
            assignment=((21, (121,)), (22, (121,))),
            comment_answers=(answer,),
        )
    )
    tick(core, 0.1)
    assert core.snapshot.receipts[0].status == "received"


def test_facts_about_strangers_and_numbers_that_are_none_change_nothing() -> None:
    core = MissionCore(mission_setup())
    core.observe(robot_state(99, (1.0, 1.0)))
    core.observe(robot_state(21, (float("nan"), 0.0)))
    core.observe(LinkChange(99, Link.LOST, "?"))
    core.observe(Attack(99, ZoneKind.SENSING, sensing_zone(), 0.0))
    core.observe(sighting_of(99, (0.0, 0.0), 121, (9.0, 9.0)))
    core.observe(sighting_of(21, (0.0, 0.0), 999, (9.0, 9.0)))
    problem = core.begin(0.0)
    assert problem.positions.tolist() == [[-2.0, 0.0], [-2.0, 2.0]]
    assert problem.sensing.centres.shape == (0, 2)
    assert np.allclose(core.beliefs.means[:, :2], [[2.0, 0.0], [2.0, 2.0]])


def test_a_target_without_prior_is_unknown_until_it_is_seen() -> None:
    setup = mission_setup()
    blind = replace(setup.targets[0], prior=None)
    core = MissionCore(replace(setup, targets=(blind, setup.targets[1])))
    problem = core.begin(0.0)
    assert problem.target_priors.shape == (1, 2, 2)
    core.commit(straight_solution(problem))
    assert core.snapshot.tracks.status == (TrackStatus.UNKNOWN, TrackStatus.TRACKED)
    core.observe(sighting_of(21, (-2.0, 0.0), 121, (2.0, 0.5)))
    problem = core.begin(0.1)
    assert problem.target_priors.shape == (2, 2, 2)
    assert problem.target_means[0, 0] == pytest.approx((2.0, 0.5), abs=0.4)


def test_a_zone_drawn_by_a_person_constrains_the_whole_team() -> None:
    core = MissionCore(mission_setup())
    core.observe(ZoneDrawn(sensing_zone("drawn")))
    assert core.begin(0.0).sensing.known.tolist() == [[True], [True]]


def test_a_team_that_is_all_gone_still_ticks() -> None:
    core = MissionCore(mission_setup())
    core.observe(LinkChange(21, Link.LOST, "token gone"))
    core.observe(LinkChange(22, Link.LOST, "token gone"))
    problem = core.begin(0.0)
    assert problem.robot_ids == ()
    assert core.commit(straight_solution(problem)) == ()


def test_the_targets_of_a_lost_robot_are_covered_in_the_very_next_problem() -> None:
    core = MissionCore(mission_setup())
    tick(core, 0.0)
    core.observe(LinkChange(21, Link.LOST, "token gone"))
    problem = core.begin(0.1)
    assert problem.robot_ids == (22,)
    assert problem.sees.tolist() == [[True, True]]
    core.commit(straight_solution(problem))
    directives = core.snapshot.directives
    assert directives.assignment == {Pairing(22, 121), Pairing(22, 122)}
    assert directives.assignment_source is Source.REPAIR
    assert core.snapshot.guidance is Guidance.SOLVER


@pytest.mark.parametrize("way", [(Link.CONNECTED,), (Link.JAMMED, Link.CONNECTED)])
def test_a_robot_that_comes_back_is_given_what_nobody_covers(way: tuple[Link, ...]) -> None:
    """Its token may be there before its first word, so that it seems jammed for a moment."""
    setup = mission_setup()
    robots = tuple(replace(robot, capacity=1) for robot in setup.robots)
    core = MissionCore(replace(setup, robots=robots))
    tick(core, 0.0)
    before = core.snapshot.directives.assignment
    core.observe(LinkChange(21, Link.LOST, "token gone"))
    tick(core, 0.1)
    assert core.snapshot.directives.assignment != before
    for step, link in enumerate(way):
        core.observe(LinkChange(21, link, "back"))
        tick(core, 0.2 + 0.1 * step)
    covered = {pairing.target_id for pairing in core.snapshot.directives.assignment}
    assert covered == {121, 122}


def test_a_robot_that_is_lost_without_need_changes_nothing_else() -> None:
    core = MissionCore(mission_setup(robots=3, targets=2))
    tick(core, 0.0)
    before = core.snapshot.directives.assignment
    core.observe(LinkChange(23, Link.LOST, "token gone"))
    tick(core, 0.1)
    assert core.snapshot.directives.assignment == before


def test_a_lost_robot_of_64_is_made_up_for_within_10_ms() -> None:
    """Picture, repair and verification run where the tick runs: they must not hold it up."""
    taken = []
    for _ in range(3):
        core = MissionCore(mission_setup(robots=64, targets=128))
        core.begin(0.0)
        core.observe(LinkChange(21, Link.LOST, "test"))
        began = time.thread_time()
        core.begin(0.1)
        taken.append(time.thread_time() - began)
        held = {pair.target_id for pair in core.directives.assignment}
        # 63 robots with two places each: as many as there is room for.
        assert len(held) == 126
        assert all(pair.robot_id != 21 for pair in core.directives.assignment)
    assert min(taken) < 0.010
