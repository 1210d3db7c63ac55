"""What stands on a decision card, and what is looked at once more before anything is in force."""

from dataclasses import replace

import pytest

from server.gate.decisions import Decision, FactKind, Loop, Refuser, Status
from server.gate.keeper import Gatekeeper
from server.gate.merit import Merit
from server.gate.rollout import Forecast
from server.mission.core import MissionCore
from server.mission.setup import GateMode
from server.mission.tape import NoTape, TapedCore
from solver.directives import (
    CommentAnswer,
    CommentVerdict,
    Pairing,
    Pin,
    Proposal,
    Source,
    Weights,
)
from solver.observations import Attack, Comment, Link, LinkChange
from solver.zones import ZoneKind
from tests.server.builders import mission_setup, robot_state, sensing_zone, straight_solution

BOLD = (20.0, 0.05, 50.0, 50.0)
BOLDER = Proposal("a1", Source.ACTION_LLM, 0.0, weights=BOLD)
SWAP = Proposal("t1", Source.TASK_LLM, 0.0, assignment=((21, (122,)), (22, (121,))))


class Bench:
    """A mission ticked by hand, and predictions by decree."""

    def __init__(self, mode: GateMode) -> None:
        setup = replace(mission_setup(tick_s=0.5), gate=mode)
        self.core = TapedCore(MissionCore(setup), NoTape())
        self.keeper = Gatekeeper(self.core, mode)
        self.now_s = 0.0
        for robot in setup.robots:
            self.core.observe(robot_state(robot.id, robot.position))
        self.tick()

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            self.core.commit(straight_solution(self.core.begin(self.now_s)))
            self.keeper.look(self.core.snapshot)
            self.now_s += 0.5

    def decide(self, proposal: Proposal, gain: float) -> Decision:
        """Bring a proposal before the gate, predicted to gain so much on a merit of 1 m^2."""
        case = self.keeper.open(proposal)
        predicted = None
        if case.comparison is not None:
            seconds = case.comparison.horizon_s
            before, after = (
                Merit(seconds, value * seconds, 0.0, 0.0, 0.0) for value in (1.0, 1.0 - gain)
            )
            predicted = Forecast(seconds, before, after)
        return self.keeper.settle(case, predicted)


def test_a_proposal_is_verified_once_more_where_it_goes_into_force() -> None:
    bench = Bench(GateMode.AUTO)
    case = bench.keeper.open(SWAP)
    assert case.comparison is not None
    bench.core.observe(LinkChange(21, Link.LOST, "gone"))
    bench.tick()
    card = bench.keeper.settle(case, None)
    assert card.refused_by is Refuser.VERIFICATION
    assert "Drone 21 is lost" in card.reasons[0]


def test_what_has_become_impossible_is_refused_though_a_person_approves_it() -> None:
    bench = Bench(GateMode.CONFIRM)
    waiting = bench.decide(SWAP, 0.1)
    assert waiting.status is Status.PENDING
    bench.core.observe(LinkChange(22, Link.LOST, "gone"))
    bench.tick()
    card = bench.keeper.approve(waiting.id, approve=True, by="ada")
    assert card.refused_by is Refuser.VERIFICATION
    assert card.approval is not None
    assert card.approval.by == "ada"


def test_a_model_that_breaks_a_persons_pin_is_refused_in_words() -> None:
    bench = Bench(GateMode.AUTO)
    pin = Pin("keep", Pairing(21, 121), expires_s=None)
    assert bench.decide(Proposal("p1", Source.OPERATOR, 0.0, pins_set=(pin,)), 0.0).accepted
    card = bench.decide(SWAP, 0.5)
    assert card.refused_by is Refuser.VERIFICATION
    assert "Drone 21 must keep Target 121: the operator fixed it." in card.reasons
    lifting = Proposal("t2", Source.TASK_LLM, 0.0, pins_lifted=("keep",))
    assert "Pins are not yours" in bench.decide(lifting, 0.0).reasons[0]


def test_a_pin_binds_only_for_its_time() -> None:
    bench = Bench(GateMode.AUTO)
    pin = Pin("keep", Pairing(21, 121), expires_s=2.0)
    bench.decide(Proposal("p1", Source.OPERATOR, 0.0, pins_set=(pin,)), 0.0)
    bench.tick(2)
    assert not bench.decide(SWAP, 0.5).accepted
    bench.tick(2)
    assert bench.decide(SWAP, 0.5).accepted


def test_a_comment_whose_effect_the_gate_refuses_is_declined_with_the_reason() -> None:
    bench = Bench(GateMode.AUTO)
    bench.core.observe(Comment("c1", "Let 21 take 122.", 0.0, 60.0))
    bench.tick()
    said = CommentAnswer("c1", CommentVerdict.APPLIED, "as asked")
    asked = replace(SWAP, comment_answers=(said,), considered=("c1",))
    card = bench.decide(asked, -0.5)
    assert card.refused_by is Refuser.GATE
    assert card.comment_ids == ("c1",)
    bench.tick()
    (receipt,) = bench.core.snapshot.receipts
    assert receipt.task is CommentVerdict.DECLINED
    assert "clearly worse" in receipt.task_reason
    assert bench.core.core.directives.pins == ()


def test_a_refused_proposal_shows_what_went_on_instead() -> None:
    bench = Bench(GateMode.AUTO)
    card = bench.decide(BOLDER, -0.5)
    assert card.effect is not None
    assert card.effect.predicted_merit == pytest.approx(1.0)
    assert bench.core.core.directives.weights != Weights(*BOLD)


def test_what_changes_within_a_window_is_named_on_its_card() -> None:
    bench = Bench(GateMode.AUTO)
    first = bench.decide(BOLDER, 0.1)
    second = bench.decide(SWAP, 0.1)
    effect = bench.keeper.card(first.id).effect
    assert effect is not None
    assert effect.overlapped_by == (second.id,)


def test_hits_are_counted_as_the_team_learns_of_them() -> None:
    bench = Bench(GateMode.AUTO)
    card = bench.decide(BOLDER, 0.1)
    bench.core.observe(Attack(21, ZoneKind.SENSING, sensing_zone(), bench.now_s))
    bench.tick()
    bench.core.observe(LinkChange(22, Link.JAMMED, "silent"))
    bench.tick(9)
    effect = bench.keeper.card(card.id).effect
    assert effect is not None
    assert effect.realised is not None
    assert effect.realised.seconds == pytest.approx(5.0)
    assert (effect.realised.sensing_hits, effect.realised.communication_hits) == (1.0, 1.0)


def test_a_repair_has_its_card() -> None:
    bench = Bench(GateMode.CONFIRM)
    bench.core.observe(LinkChange(21, Link.LOST, "gone"))
    bench.tick()
    (card,) = bench.keeper.take()
    assert (card.loop, card.source, card.status) == (Loop.SOLVER, Source.REPAIR, Status.ADOPTED)
    assert {row.robot_id for row in card.changes.assignment} == {21, 22}


def test_a_repair_in_the_first_tick_of_a_mission_that_was_brought_back_has_its_card() -> None:
    bench = Bench(GateMode.AUTO)
    bench.keeper = Gatekeeper(bench.core, GateMode.AUTO, made=4)
    bench.core.observe(LinkChange(21, Link.LOST, "gone"))
    bench.tick()
    (card,) = bench.keeper.cards()
    assert (card.id, card.source, card.status) == ("d5", Source.REPAIR, Status.ADOPTED)
    assert {row.robot_id for row in card.changes.assignment} >= {22}


def test_a_card_cites_what_the_proposal_was_made_from() -> None:
    bench = Bench(GateMode.AUTO)
    bench.core.observe(Attack(21, ZoneKind.SENSING, sensing_zone("s1"), 0.0))
    bench.core.observe(Comment("c1", "The zone is worse than we think.", 0.0, 60.0))
    bench.core.observe(robot_state(22, (-2.0, 2.0), sensing_failed=True))
    bench.tick()
    asked = Proposal(
        "a1",
        Source.ACTION_LLM,
        0.0,
        severities=(("s1", 2.0),),
        feedback="Zone s1 hit Drone 21, so it is taken more seriously.",
        considered=("c1",),
    )
    card = bench.decide(asked, 0.1)
    about = {fact.kind: fact for fact in card.facts}
    assert set(about) == set(FactKind)
    assert about[FactKind.ZONE].zone_id == "s1"
    assert about[FactKind.ATTACK].robot_id == 21
    assert about[FactKind.FAILURE].robot_id == 22
    assert about[FactKind.COMMENT].comment_id == "c1"
    assert about[FactKind.TRACE].value == pytest.approx(bench.core.snapshot.trace)
    assert card.changes.severities == (("s1", 1.0, 2.0),)
