"""The gate in virtual time: a proposal is predicted and decided in the instant it arrives."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from llm.consultation import Accepted, Consultation, GivenUp
from server.gate.decisions import Attempt, Decision
from server.gate.keeper import Gatekeeper
from server.gate.rollout import forecast
from server.mission.setup import GateMode
from server.mission.tape import TapedCore
from solver.directives import Proposal
from solver.planner import Planner

Listener = Callable[[Decision, tuple[Attempt, ...]], None]
"""Told of every card that is new or changed, with the prompts and answers behind it."""


@dataclass(slots=True)
class Council:
    """Decides the proposals of one lockstep mission."""

    core: TapedCore
    mode: GateMode
    planner: Planner
    """The gate's own."""

    keeper: Gatekeeper = field(init=False)
    forecasts_s: list[float] = field(default_factory=list)
    """Thread time of each prediction."""

    listeners: list[Listener] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.keeper = Gatekeeper(self.core, self.mode)

    def tell(self) -> None:
        """Tell the listeners which cards are new or changed since the last call."""
        for card in self.keeper.take():
            for listener in self.listeners:
                listener(card, self.keeper.exchange(card.id))

    def decide(self, consultation: Consultation, outcome: Accepted | GivenUp) -> Decision:
        """Decide what a consultation came to."""
        if isinstance(outcome, GivenUp):
            return self.keeper.give_up(consultation)
        return self.propose(outcome.proposal, consultation)

    def propose(self, proposal: Proposal, consultation: Consultation | None = None) -> Decision:
        """Decide a proposal, or let it wait for a person."""
        case = self.keeper.open(proposal, consultation)
        predicted = None
        if case.comparison is not None:
            began_s = time.thread_time()
            predicted = forecast(case.comparison, self.planner)
            self.forecasts_s.append(time.thread_time() - began_s)
        return self.keeper.settle(case, predicted)
