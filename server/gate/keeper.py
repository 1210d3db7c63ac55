"""The gatekeeper: takes every proposal from its arrival to its end, and keeps the cards.

Sans-I/O, on mission time: live and lockstep drive the same one. `open` looks at a proposal as
it arrives, `server.gate.rollout.forecast` predicts beside the tick, `settle` verifies once more
and decides, `approve` takes a person's word, `look` lets time pass. Only `settle`, `approve` and
`look` touch the mission, and must be called between its ticks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

from llm.consultation import Consultation, Fault
from llm.prompts import Loop as ModelLoop
from llm.verification import verify
from server.gate.comparing import comparison_of
from server.gate.decisions import (
    LOOPS,
    Approval,
    Attempt,
    Changes,
    Decision,
    Effect,
    Judgement,
    Loop,
    Refuser,
    Status,
    changes_between,
)
from server.gate.drift import Drift
from server.gate.effects import Odometer, Reading
from server.gate.facts import cited
from server.gate.judging import Judge
from server.gate.merit import MeritPrices
from server.gate.rollout import Comparison, Forecast
from server.mission.setup import GateMode
from server.mission.tape import TapedCore
from solver.directives import Proposal, Source, Verdict
from solver.observations import Attack
from solver.snapshot import Snapshot

CARDS_KEPT = 1000
EXCHANGES_KEPT = 100
LONGEST_TEXT = 16_000
"""Characters of one prompt or answer that are kept."""

RECENT_S = 30.0
"""An attack is cited for this long."""

_FREE = frozenset({Source.OPERATOR, Source.REPAIR})
"""Who passes the gate: people in person, and covering a lost robot's targets at once."""

_AUTHORS = {
    Source.TASK_LLM: "task model",
    Source.ACTION_LLM: "action model",
    Source.EXACT: "assignment solver",
    Source.REPAIR: "repair",
}
_FAULTS = {
    Fault.NO_REPLY: Refuser.NO_ANSWER,
    Fault.UNREADABLE: Refuser.PARSING,
    Fault.VIOLATION: Refuser.VERIFICATION,
}


class DecisionUnknown(KeyError):
    """Raised when there is no decision of an id."""


class NotPending(ValueError):
    """Raised when a decision waits for nobody; carries its card."""

    def __init__(self, card: Decision) -> None:
        super().__init__(f"decision {card.id} is {card.status} already")
        self.card = card


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A proposal on its way from arrival to decision."""

    card: Decision
    proposal: Proposal
    comparison: Comparison | None
    """What to predict; None where there is nothing to be predicted."""


@dataclass(frozen=True, slots=True, eq=False)
class _Window:
    """An effect that is waited for."""

    decision_id: str
    start: Reading


class Gatekeeper:
    """Owner of the decisions of one mission."""

    def __init__(self, core: TapedCore, mode: GateMode, made: int = 0) -> None:
        """Keep the decisions of a mission; `made` were made before its process began."""
        setup = core.core.setup
        self.mode = mode
        self.prices = MeritPrices.of(setup)
        self._core = core
        self._judge = Judge(mode, self.prices, setup.merit.margin)
        self._approval_s = setup.merit.approval_s
        self._drift = Drift(len(setup.targets))
        self._odometer = Odometer()
        self._ids = count(made + 1)
        self._cards: dict[str, Decision] = {}
        self._exchanges: dict[str, tuple[Attempt, ...]] = {}
        self._pending: dict[str, tuple[Proposal, Forecast | None]] = {}
        self._windows: list[_Window] = []
        self._told: dict[str, None] = {}
        self._attacks: dict[int, Attack] = {}
        self._last = core.core.snapshot

    # ------------------------------------------------------------------ a proposal's way

    def open(self, proposal: Proposal, consultation: Consultation | None = None) -> Case:
        """Take a proposal as it arrives: verify it, see what it changes. Decides nothing."""
        core = self._core.core
        snapshot = core.current
        verdict = verify(proposal, snapshot, core.limits)
        changes, comparison = Changes(), None
        if verdict.accepted:
            after = core.outlook(proposal)
            changes = changes_between(snapshot.directives, after, proposal.replan)
            asked = self.mode is not GateMode.OFF or proposal.source is Source.OPERATOR
            if asked and _is_predictable(changes) and proposal.source is not Source.REPAIR:
                comparison = comparison_of(core, after, proposal.replan, self._drift.velocities)
        card = self._card(proposal, changes, verdict, snapshot)
        if consultation is not None:
            card = replace(card, tries=consultation.stats.tries)
            self._keep_exchange(card.id, consultation)
        return Case(card, proposal, comparison)

    def settle(self, case: Case, forecast: Forecast | None) -> Decision:
        """Decide a case now: verify it against the newest snapshot, judge, adopt or refuse."""
        proposal, core = case.proposal, self._core.core
        verdict = verify(proposal, core.current, core.limits)
        card = replace(case.card, verification=verdict)
        if not verdict.accepted:
            self._core.propose(proposal)
            return self._end(card, Refuser.VERIFICATION, verdict.violations)
        after = core.outlook(proposal)
        changes = changes_between(core.directives, after, proposal.replan)
        ruling = self._judge.rule(changes, forecast)
        card = replace(card, changes=changes, gate=ruling)
        if proposal.source in _FREE or not card.changes:
            return self._adopt(card, proposal, forecast)
        if self.mode is GateMode.CONFIRM:
            return self._ask(card, proposal, forecast)
        if self.mode is GateMode.AUTO and ruling.judgement is Judgement.CLEARLY_WORSE:
            return self._refuse(card, proposal, forecast, Refuser.GATE, (ruling.reason,))
        return self._adopt(card, proposal, forecast)

    def give_up(self, consultation: Consultation) -> Decision:
        """Take note of a consultation that ended without a valid answer."""
        source = Source.TASK_LLM if consultation.loop is ModelLoop.TASK else Source.ACTION_LLM
        last = consultation.attempts[-1]
        standing = consultation.view.receipts
        proposal = Proposal(
            id=consultation.proposal_id,
            source=source,
            asked_s=consultation.view.snapshot.time_s,
            considered=tuple(receipt.comment.id for receipt in standing),
        )
        refuser = _FAULTS[last.fault or Fault.NO_REPLY]
        verdict = None
        if refuser is Refuser.VERIFICATION:
            verdict = Verdict(proposal.id, last.reasons)
        card = self._card(proposal, Changes(), verdict, self._core.core.current)
        self._keep_exchange(card.id, consultation)
        return self._end(replace(card, tries=consultation.stats.tries), refuser, last.reasons)

    def approve(self, decision_id: str, *, approve: bool, by: str) -> Decision:
        """Take a person's word on a pending decision.

        Raises DecisionUnknown, NotPending.
        """
        card = self.card(decision_id)
        if decision_id not in self._pending or card.approval is None:
            raise NotPending(card)
        proposal, forecast = self._pending.pop(decision_id)
        card = replace(card, approval=replace(card.approval, approved=approve, by=by))
        if not approve:
            reason = f"{by.capitalize()} refused it."
            return self._refuse(card, proposal, forecast, Refuser.PERSON, (reason,))
        core = self._core.core
        verdict = verify(proposal, core.current, core.limits)
        card = replace(card, verification=verdict)
        if not verdict.accepted:
            self._core.propose(proposal)
            return self._end(card, Refuser.VERIFICATION, verdict.violations)
        return self._adopt(card, proposal, forecast)

    def look(self, snapshot: Snapshot) -> None:
        """Take note of a committed tick: repairs, approvals out of time, effects that are over."""
        self._drift.look(snapshot)
        self._odometer.look(snapshot)
        for attack in snapshot.attacks:
            self._attacks[attack.robot_id] = attack
        self._note_repair(snapshot)
        self._last = snapshot
        for decision_id, (proposal, forecast) in tuple(self._pending.items()):
            card = self._cards[decision_id]
            if card.approval is not None and snapshot.time_s >= card.approval.expires_s - 1e-9:
                del self._pending[decision_id]
                reason = f"Nobody approved it within {self._approval_s:g} s."
                self._refuse(card, proposal, forecast, Refuser.TIMEOUT, (reason,))
        self._close_windows(snapshot.time_s)

    # ------------------------------------------------------------------ to be read

    def card(self, decision_id: str) -> Decision:
        """Return the newest state of a card. Raises DecisionUnknown."""
        if decision_id not in self._cards:
            raise DecisionUnknown(decision_id)
        return self._cards[decision_id]

    def cards(self) -> tuple[Decision, ...]:
        """Return the kept cards, oldest first."""
        return tuple(self._cards.values())

    def exchange(self, decision_id: str) -> tuple[Attempt, ...]:
        """Return the prompts and answers behind a card; empty where there are none (any more)."""
        return self._exchanges.get(decision_id, ())

    def take(self) -> tuple[Decision, ...]:
        """Return the cards that are new or changed since the last call, in order."""
        told, self._told = self._told, {}
        return tuple(self._cards[decision_id] for decision_id in told)

    # ------------------------------------------------------------------ inside

    def _card(
        self, proposal: Proposal, changes: Changes, verdict: Verdict | None, snapshot: Snapshot
    ) -> Decision:
        now_s = max(0.0, snapshot.time_s)
        attacks = [a for a in self._attacks.values() if now_s - a.time_s <= RECENT_S]
        answered = tuple(answer.comment_id for answer in proposal.comment_answers)
        return Decision(
            id=f"d{next(self._ids)}",
            proposal_id=proposal.id,
            loop=LOOPS.get(proposal.source, Loop.PEOPLE),
            source=proposal.source,
            author=proposal.author or _AUTHORS.get(proposal.source, "operator"),
            asked_s=proposal.asked_s,
            time_s=now_s,
            status=Status.PENDING,
            changes=changes,
            facts=cited(proposal, changes, snapshot, attacks),
            feedback=proposal.feedback,
            verification=verdict,
            comment_ids=tuple(dict.fromkeys((*proposal.considered, *answered))),
        )

    def _ask(self, card: Decision, proposal: Proposal, forecast: Forecast | None) -> Decision:
        now_s = self._now_s
        self._pending[card.id] = (proposal, forecast)
        return self._keep(replace(card, approval=Approval(now_s, now_s + self._approval_s)))

    def _adopt(self, card: Decision, proposal: Proposal, forecast: Forecast | None) -> Decision:
        self._core.propose(proposal)
        self._judge.adopted(proposal.source, card.gate)
        if card.changes:
            self._overlap(card.id)
        card = replace(card, status=Status.ADOPTED, decided_s=self._now_s)
        return self._keep(self._await_effect(card, forecast))

    def _refuse(
        self,
        card: Decision,
        proposal: Proposal,
        forecast: Forecast | None,
        refuser: Refuser,
        reasons: tuple[str, ...],
    ) -> Decision:
        """Refuse a verified proposal; the directives in force go on, and have their effect."""
        self._core.propose(proposal, reasons)
        return self._end(card, refuser, reasons, forecast)

    def _end(
        self,
        card: Decision,
        refuser: Refuser,
        reasons: Sequence[str],
        forecast: Forecast | None = None,
    ) -> Decision:
        card = replace(
            card,
            status=Status.REFUSED,
            refused_by=refuser,
            reasons=tuple(reasons),
            decided_s=self._now_s,
        )
        return self._keep(self._await_effect(card, forecast))

    def _await_effect(self, card: Decision, forecast: Forecast | None) -> Decision:
        if forecast is None:
            return card
        adopted = card.status is Status.ADOPTED
        predicted = forecast.proposed if adopted else forecast.in_force
        self._windows.append(_Window(card.id, self._odometer.reading))
        now_s = self._now_s
        effect = Effect(
            from_s=now_s,
            until_s=now_s + forecast.horizon_s,
            predicted=predicted,
            predicted_merit=predicted.per_second(self.prices),
        )
        return replace(card, effect=effect)

    def _overlap(self, decision_id: str) -> None:
        """Tell the open effects that something else changes now."""
        for window in self._windows:
            card = self._cards.get(window.decision_id)
            if card is not None and card.effect is not None and card.id != decision_id:
                others = (*card.effect.overlapped_by, decision_id)
                self._cards[card.id] = replace(
                    card, effect=replace(card.effect, overlapped_by=others)
                )

    def _close_windows(self, now_s: float) -> None:
        still = []
        for window in self._windows:
            card = self._cards.get(window.decision_id)
            if card is None or card.effect is None:
                continue
            if now_s < card.effect.until_s - 1e-9:
                still.append(window)
                continue
            realised = self._odometer.reading.since(window.start)
            merit = realised.per_second(self.prices)
            self._keep(
                replace(card, effect=replace(card.effect, realised=realised, realised_merit=merit))
            )
        self._windows = still

    def _note_repair(self, snapshot: Snapshot) -> None:
        """Write the card of a repair, which the core makes by itself and at once."""
        before, after = self._last.directives, snapshot.directives
        if after.assignment_source is not Source.REPAIR or after == before:
            return
        if after.assignment_since_s != snapshot.time_s:
            return
        name = f"repair-{snapshot.tick}"
        proposal = Proposal(id=name, source=Source.REPAIR, asked_s=snapshot.time_s)
        changes = changes_between(before, after)
        card = self._card(proposal, changes, Verdict(name), snapshot)
        self._overlap(card.id)
        self._keep(replace(card, status=Status.ADOPTED, decided_s=snapshot.time_s))

    @property
    def _now_s(self) -> float:
        return max(0.0, self._core.snapshot.time_s)

    def _keep(self, card: Decision) -> Decision:
        self._cards[card.id] = card
        self._told[card.id] = None
        while len(self._cards) > CARDS_KEPT:
            oldest = next(iter(self._cards))
            if oldest in self._pending:
                break
            del self._cards[oldest]
            self._told.pop(oldest, None)
        return card

    def _keep_exchange(self, decision_id: str, consultation: Consultation) -> None:
        self._exchanges[decision_id] = tuple(
            Attempt(
                prompt="\n\n".join(f"[{m.role}]\n{m.content}" for m in each.request.messages)[
                    :LONGEST_TEXT
                ],
                answer=each.text[:LONGEST_TEXT],
                reasons=each.reasons,
            )
            for each in consultation.attempts
        )
        while len(self._exchanges) > EXCHANGES_KEPT:
            del self._exchanges[next(iter(self._exchanges))]


def _is_predictable(changes: Changes) -> bool:
    """Return whether anything changes that a roll-out can tell apart."""
    return any((changes.assignment, changes.weights, changes.severities, changes.replan))
