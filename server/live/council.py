"""The gate, live: predictions beside the tick, decisions between ticks, people's words.

A proposal is looked at when it arrives, predicted in another thread, and decided before the
next tick begins; while mission time stands still, at once.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from llm.consultation import Accepted, Consultation, GivenUp
from server.gate.decisions import Decision, Status
from server.gate.decisions import Loop as CardLoop
from server.gate.encoding import with_decisions
from server.gate.keeper import Gatekeeper
from server.live.channel import Json, RequestRefused
from server.live.forecasting import Forecaster
from server.live.herald import Herald
from server.mission.tape import TapedCore
from solver.directives import Proposal, Source
from solver.snapshot import Snapshot

PEOPLE_PATIENCE_S: Final = 1.0
"""Longest a person waits for the predicted price of an override."""


@dataclass(frozen=True, slots=True)
class _Pending:
    """A decision that waits for a person."""

    loop: CardLoop
    answer: asyncio.Future[Decision]
    """Of who proposed it."""


class LiveCouncil:
    """Owner of what waits to be decided. All methods on the mission's event loop."""

    def __init__(
        self,
        core: TapedCore,
        forecaster: Forecaster,
        herald: Herald,
        wake: Callable[[], None],
        note: Callable[[Decision], None],
        made: int = 0,
    ) -> None:
        setup = core.core.setup
        self._loops = setup.loops
        self._keeper = Gatekeeper(core, setup.gate, made)
        self._forecaster = forecaster
        self._herald = herald
        self._wake = wake
        self._note = note
        self._waiting: deque[tuple[Callable[[], Decision], asyncio.Future[Decision]]] = deque()
        self._pending: dict[str, _Pending] = {}
        """Decisions that wait for a person, and those who wait for them."""

        self._since_s = 0.0 if setup.start is None else setup.start.time_s
        self._closed = False
        self._onlookers: list[asyncio.Future[None]] = []
        """Those who wait for the tick to be over."""

    async def decide(self, consultation: Consultation, outcome: Accepted | GivenUp) -> Decision:
        """Bring what a consultation came to before the gate; return the decision."""
        if isinstance(outcome, GivenUp):
            card = self._keeper.give_up(consultation)
            self._tell()
            return card
        return await self.propose(outcome.proposal, consultation)

    async def propose(
        self, proposal: Proposal, consultation: Consultation | None = None
    ) -> Decision:
        """Bring a proposal before the gate; return when it is decided, by a person if need be."""
        case = self._keeper.open(proposal, consultation)
        predicted = None
        if case.comparison is not None:
            patience_s = self._patience_s(proposal.source)
            predicted = await self._forecaster.predict(case.comparison, patience_s)
        card = await self._between_ticks(lambda: self._keeper.settle(case, predicted))
        if card.status is not Status.PENDING:
            return card
        decided: asyncio.Future[Decision] = asyncio.get_running_loop().create_future()
        self._pending[card.id] = _Pending(card.loop, decided)
        try:
            return await decided
        finally:
            del self._pending[card.id]

    async def approve(self, decision_id: str, *, approve: bool, by: str) -> Decision:
        """Take a person's word on a pending decision.

        Raises server.gate.keeper.DecisionUnknown, NotPending.
        """
        return await self._between_ticks(
            lambda: self._keeper.approve(decision_id, approve=approve, by=by)
        )

    def waits_for_person(self, loop: CardLoop) -> bool:
        """Tell whether a decision of a loop waits for a person, and the loop for it."""
        return any(pending.loop is loop for pending in self._pending.values())

    def settle_waiting(self) -> None:
        """Decide what waits for it. Never while a tick is being solved."""
        while self._waiting:
            decide, answer = self._waiting.popleft()
            try:
                card = decide()
            except Exception as error:  # noqa: BLE001 (it must not end the flight: its asker's)
                if not answer.done():
                    answer.set_exception(error)
                continue
            if not answer.done():
                answer.set_result(card)
        self._tell()

    def look(self, snapshot: Snapshot) -> None:
        """Let a committed tick pass: approvals run out, effects show."""
        self._keeper.look(snapshot)
        self._tell()
        self._let_go()

    async def tick_over(self) -> None:
        """Return when the next tick has been committed, or the mission has ended meanwhile.

        Raises RequestRefused when it has ended already.
        """
        if self._closed:
            raise _ended()
        over: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._onlookers.append(over)
        await over

    def close(self) -> None:
        """Let go who still waits: nothing is decided any more."""
        self._closed = True
        for _, answer in self._waiting:
            if not answer.done():
                answer.set_exception(_ended())
        self._waiting.clear()
        self._let_go()

    def result(self, figures: Json) -> Json:
        """Return a mission's figures with its decisions."""
        return with_decisions(figures, self._keeper, self._forecaster.spent_s, self._since_s)

    async def _between_ticks(self, decide: Callable[[], Decision]) -> Decision:
        if self._closed:
            raise _ended()
        answer: asyncio.Future[Decision] = asyncio.get_running_loop().create_future()
        self._waiting.append((decide, answer))
        self._wake()
        return await answer

    def _let_go(self) -> None:
        onlookers, self._onlookers = self._onlookers, []
        for over in onlookers:
            if not over.done():
                over.set_result(None)

    def _patience_s(self, source: Source) -> float:
        """Return how long a prediction may take: the loop's period, or what people bear."""
        if source is Source.OPERATOR:
            return PEOPLE_PATIENCE_S
        action = source is Source.ACTION_LLM
        return self._loops.action_period_s if action else self._loops.task_period_s

    def _tell(self) -> None:
        """Tell of decisions that are new or changed, and let go who waits for them."""
        for card in self._keeper.take():
            self._note(card)
            self._herald.decision(card, self._keeper.exchange(card.id))
            waiting = self._pending.get(card.id)
            if waiting is None or card.status is Status.PENDING or waiting.answer.done():
                continue
            waiting.answer.set_result(card)


def _ended() -> RequestRefused:
    return RequestRefused("wrong_state", "the mission has ended")
