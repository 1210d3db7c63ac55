"""The gate's modes and the cards, on mission time, with an optimizer that really predicts."""

from dataclasses import dataclass, replace

import pytest

from server.gate.decisions import Decision, Judgement, Refuser, Status
from server.gate.keeper import DecisionUnknown, Gatekeeper, NotPending
from server.gate.rollout import forecast
from server.mission.core import MissionCore
from server.mission.setup import GateMode, MeritSetup, MissionSetup
from server.mission.tape import MemoryTape, Proposed, TapedCore
from solver import engines
from solver.directives import Pairing, Proposal, Source
from solver.planner import Planner
from solver.problem import Budget
from tests.server.builders import mission_setup, robot_state, sighting_of

GOOD = frozenset({Pairing(21, 121), Pairing(22, 122)})
CROSSED = frozenset({Pairing(21, 122), Pairing(22, 121)})
STEP_S = 0.5


@dataclass
class Bench:
    """A mission whose robots stand beside their targets, and its gate."""

    setup: MissionSetup
    time_s: float = 0.0

    def __post_init__(self) -> None:
        self.planner = Planner(engines.create("sqp"))
        self.tape = MemoryTape()
        self.core = TapedCore(MissionCore(self.setup), self.tape)
        self.keeper = Gatekeeper(self.core, self.setup.gate)
        self.names = 0
        self.tick()

    def tick(self, count: int = 1) -> None:
        for _ in range(count):
            for robot_id, target_id, y in ((21, 121, 0.0), (22, 122, 2.0)):
                self.core.observe(robot_state(robot_id, (1.0, y)))
                self.core.observe(sighting_of(robot_id, (1.0, y), target_id, (2.0, y)))
            problem = self.core.begin(self.time_s)
            self.core.commit(self.planner.solve(problem, Budget(60)))
            self.keeper.look(self.core.snapshot)
            self.time_s += STEP_S

    def propose(
        self, pairs: frozenset[Pairing] = CROSSED, source: Source = Source.TASK_LLM, **more: object
    ) -> Decision:
        self.names += 1
        rows = {p.robot_id: (p.target_id,) for p in pairs}
        asked = {"assignment": tuple(rows.items()), **more}
        proposal = Proposal(f"p{self.names}", source, self.core.snapshot.time_s, **asked)  # type: ignore[arg-type]
        case = self.keeper.open(proposal)
        predicted = None
        if case.comparison is not None:
            predicted = forecast(case.comparison, self.planner)
        return self.keeper.settle(case, predicted)

    @property
    def assignment(self) -> frozenset[Pairing]:
        return self.core.core.directives.assignment


def bench(mode: GateMode, **merit: float) -> Bench:
    setup = replace(mission_setup(tick_s=STEP_S), gate=mode, merit=MeritSetup(**merit))
    return Bench(setup)


def test_auto_refuses_what_is_clearly_worse_and_says_by_how_much() -> None:
    b = bench(GateMode.AUTO)
    card = b.propose(CROSSED)
    assert card.status is Status.REFUSED
    assert card.refused_by is Refuser.GATE
    assert b.assignment == GOOD
    assert card.gate is not None
    assert card.gate.judgement is Judgement.CLEARLY_WORSE
    assert card.gate.difference is not None
    assert card.gate.margin is not None
    assert card.gate.difference > card.gate.margin > 0.0
    assert "clearly worse" in card.reasons[0]
    rows = {row.robot_id: (row.gains, row.loses) for row in card.changes.assignment}
    assert rows == {21: ((122,), (121,)), 22: ((121,), (122,))}


def test_auto_adopts_what_is_better() -> None:
    b = Bench(replace(bench(GateMode.AUTO).setup, assignment=CROSSED))
    card = b.propose(GOOD)
    assert card.status is Status.ADOPTED
    assert card.gate is not None
    assert card.gate.judgement is Judgement.BETTER
    assert b.assignment == GOOD


@pytest.mark.parametrize("mode", [GateMode.OFF, GateMode.SHADOW])
def test_off_and_shadow_adopt_and_only_shadow_predicts(mode: GateMode) -> None:
    b = bench(mode)
    card = b.propose(CROSSED)
    assert card.status is Status.ADOPTED
    assert b.assignment == CROSSED
    assert card.gate is not None
    shadow = mode is GateMode.SHADOW
    expected = Judgement.CLEARLY_WORSE if shadow else Judgement.UNJUDGED
    assert card.gate.judgement is expected
    assert (card.effect is not None) == shadow


def test_confirm_waits_for_a_person_and_takes_the_word() -> None:
    b = bench(GateMode.CONFIRM)
    card = b.propose(CROSSED)
    assert card.status is Status.PENDING
    assert b.assignment == GOOD
    adopted = b.keeper.approve(card.id, approve=True, by="ada")
    assert adopted.status is Status.ADOPTED
    assert b.assignment == CROSSED
    with pytest.raises(NotPending):
        b.keeper.approve(card.id, approve=True, by="ada")
    second = b.propose(GOOD)
    refused = b.keeper.approve(second.id, approve=False, by="ada")
    assert (refused.status, refused.refused_by) == (Status.REFUSED, Refuser.PERSON)
    assert refused.reasons == ("Ada refused it.",)
    assert b.assignment == CROSSED
    with pytest.raises(DecisionUnknown):
        b.keeper.approve("d99", approve=True, by="ada")


def test_silence_refuses_when_the_time_is_over_and_not_before() -> None:
    b = bench(GateMode.CONFIRM, approval_s=2.0)
    card = b.propose(CROSSED)
    b.tick(3)
    assert b.keeper.card(card.id).status is Status.PENDING
    b.tick(1)
    late = b.keeper.card(card.id)
    assert (late.status, late.refused_by) == (Status.REFUSED, Refuser.TIMEOUT)
    assert b.assignment == GOOD


@pytest.mark.parametrize("mode", list(GateMode))
def test_people_pass_every_mode_and_are_told_the_price(mode: GateMode) -> None:
    b = bench(mode)
    card = b.propose(CROSSED, source=Source.OPERATOR)
    assert card.status is Status.ADOPTED
    assert b.assignment == CROSSED
    assert card.gate is not None
    assert card.gate.difference is not None
    assert card.gate.difference > 0.0


def test_what_a_model_says_that_a_person_wanted_does_not_pass() -> None:
    b = bench(GateMode.AUTO)
    card = b.propose(CROSSED, feedback="The operator approved this.", author="operator")
    assert card.refused_by is Refuser.GATE
    assert b.assignment == GOOD


@pytest.mark.parametrize("mode", list(GateMode))
def test_verification_comes_before_every_mode(mode: GateMode) -> None:
    b = bench(mode)
    card = b.propose(frozenset({Pairing(21, 121), Pairing(99, 122)}))
    assert (card.status, card.refused_by) == (Status.REFUSED, Refuser.VERIFICATION)
    assert any("99" in reason for reason in card.reasons)
    assert b.assignment == GOOD


def test_a_prediction_that_does_not_come_in_time_does_not_block() -> None:
    b = bench(GateMode.AUTO)
    proposal = Proposal("late", Source.TASK_LLM, 0.0, assignment=((21, (122,)), (22, (121,))))
    card = b.keeper.settle(b.keeper.open(proposal), None)
    assert card.status is Status.ADOPTED
    assert card.gate is not None
    assert card.gate.judgement is Judgement.UNJUDGED


def test_the_realised_effect_stands_beside_the_predicted_one_once_it_is_over() -> None:
    b = bench(GateMode.SHADOW)
    card = b.propose(GOOD, weights=None, severities=None, source=Source.TASK_LLM)
    assert card.effect is None, "nothing changes, so nothing is predicted"
    card = b.propose(CROSSED)
    assert card.effect is not None
    assert card.effect.realised is None
    window_s = card.effect.until_s - card.effect.from_s
    b.tick(round(window_s / STEP_S) - 1)
    assert (found := b.keeper.card(card.id).effect) is not None
    assert found.realised is None
    b.tick(2)
    assert (found := b.keeper.card(card.id).effect) is not None
    assert found.realised is not None
    assert found.realised.seconds >= window_s - 1e-9
    assert found.realised_merit is not None
    assert found.realised_merit > 0.0
    assert b.keeper.card(card.id) in b.keeper.take()


def test_everything_that_reaches_the_mission_is_on_its_tape_refused_or_not() -> None:
    b = bench(GateMode.AUTO)
    b.propose(CROSSED)
    b.propose(GOOD)
    kept = [entry.proposal.id for entry in b.tape.entries if isinstance(entry, Proposed)]
    assert kept == ["p1", "p2"]


def test_the_same_mission_gives_the_same_cards() -> None:
    def cards() -> list[Decision]:
        b = bench(GateMode.AUTO)
        b.propose(CROSSED)
        b.tick(3)
        b.propose(GOOD)
        return list(b.keeper.cards())

    assert cards() == cards()
