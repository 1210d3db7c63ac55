"""The two model loops on the virtual clock.

The question is asked from the snapshot at t; the real call is awaited at once, and its answer
is kept back until t plus the latency has come in mission time. It is verified against the
snapshot of that moment; a further try starts then, and adds its own latency.
"""

from collections.abc import Callable
from dataclasses import dataclass

from llm.chat import ChatReply, ErrorKind, LanguageModel, ModelError
from llm.consultation import Consultation, Retry
from server.advice import Advisors, Ask, Relief, tally_outcome
from server.exact import ExactSolver
from server.gate.decisions import Status
from server.lockstep.council import Council
from server.lockstep.job import Latency
from server.loops import LoopClock
from server.models import Manner
from server.result import LoopTally

REAL_TIMEOUT_S = 60.0
"""Longest a real call may take in lockstep; mission time stands still meanwhile."""


@dataclass(slots=True)
class _Pending:
    """An answer on its way."""

    consultation: Consultation
    asked_s: float
    arrival_s: float
    answer: ChatReply | ModelError


@dataclass(frozen=True, slots=True)
class _Answered:
    """An answer that has arrived and may still have to be decided."""

    decision_id: str
    pending: _Pending


class VirtualLoop:
    """One model's loop in virtual time: at most one answer on its way."""

    def __init__(
        self,
        clock: LoopClock,
        council: Council,
        model: LanguageModel,
        consult: Callable[[], Ask],
        latency_s: float | None,
        timeout_s: float,
    ) -> None:
        self.clock = clock
        self.tally = LoopTally()
        self._council = council
        self._model = model
        self._consult = consult
        self._latency_s = latency_s
        self._timeout_s = timeout_s
        self._pending: _Pending | None = None
        self._answered: _Answered | None = None

    async def deliver(self, now_s: float) -> None:
        """Hand over the answer that has arrived by now, if any; send a further try if need be."""
        pending = self._pending
        while pending is not None and pending.arrival_s <= now_s + 1e-9:
            self._pending = None
            consultation = pending.consultation
            if isinstance(pending.answer, ModelError):
                outcome = consultation.fail(pending.answer)
            else:
                outcome = consultation.receive(pending.answer, self._council.core.snapshot)
            if isinstance(outcome, Retry):
                pending = await self._send(consultation, pending.asked_s, pending.arrival_s)
                self._pending = pending
                continue
            card = self._council.decide(consultation, outcome)
            self._answered = _Answered(card.id, pending)
            pending = None
        self._finish(now_s)

    def _finish(self, now_s: float) -> None:
        """Count the answer that was decided; one that waits for a person keeps the loop busy."""
        answered = self._answered
        if answered is None:
            return
        card = self._council.keeper.card(answered.decision_id)
        if card.status is Status.PENDING:
            return
        self._answered = None
        sent = answered.pending
        tally_outcome(self.tally, sent.consultation, adopted=card.accepted)
        self.tally.latency_s.add(sent.arrival_s - sent.asked_s)
        waited = card.approval is not None
        self.clock.finished(now_s if waited else sent.arrival_s)

    async def ask(self, now_s: float) -> None:
        """Start a call when the loop is due."""
        if self.clock.due(now_s):
            self.clock.started(now_s)
            self._pending = await self._send(self._consult()(), now_s, now_s)

    async def _send(self, consultation: Consultation, asked_s: float, sent_s: float) -> _Pending:
        answer: ChatReply | ModelError
        try:
            answer = await self._model.complete(consultation.request, REAL_TIMEOUT_S)
            latency_s = answer.latency_s if self._latency_s is None else self._latency_s
        except ModelError as error:
            answer = error
            slow = error.kind is ErrorKind.TIMEOUT
            latency_s = self._timeout_s if slow else self._latency_s or 0.0
        if latency_s > self._timeout_s:
            answer = ModelError(ErrorKind.TIMEOUT, f"no answer within {self._timeout_s:g} s")
            latency_s = self._timeout_s
        return _Pending(consultation, asked_s, sent_s + latency_s, answer)


class VirtualAdvice:
    """Both loops of a lockstep mission."""

    def __init__(
        self,
        council: Council,
        model: LanguageModel,
        latency: Latency,
        manner: Manner = Manner(),  # noqa: B008 - immutable
    ) -> None:
        core = council.core
        periods = core.core.setup.loops
        self._core = core
        self._council = council
        self._relief = Relief(periods.task_period_s, max(0.0, core.snapshot.time_s))
        council.listeners.append(lambda card, _: self._relief.note(card))
        self._solver = ExactSolver(core.core.setup)
        self._reliefs = 0
        self._advisors = Advisors(core.core, manner.style)
        self._task = VirtualLoop(
            LoopClock(periods.task_period_s),
            council,
            model,
            self._advisors.task,
            latency.task_s,
            manner.timeout_s,
        )
        self._action = VirtualLoop(
            LoopClock(periods.action_period_s),
            council,
            model,
            self._advisors.action,
            latency.action_s,
            manner.timeout_s,
        )

    @property
    def task(self) -> LoopTally:
        """The task loop's figures."""
        return self._task.tally

    @property
    def action(self) -> LoopTally:
        """The action loop's figures."""
        return self._action.tally

    async def deliver(self, now_s: float) -> None:
        """Hand over every answer that has arrived by now, task before action."""
        await self._task.deliver(now_s)
        await self._action.deliver(now_s)

    async def ask(self, now_s: float) -> None:
        """Look at the newest snapshot: wake the loops by its events, ask where one is due."""
        events = self._advisors.look(self._core.snapshot)
        if self._relief.due(now_s):
            self._reliefs += 1
            name = f"x{self._reliefs}"
            self._council.propose(self._solver.propose(self._core.snapshot, name))
        if events.task:
            self._task.clock.wake(now_s)
        if events.action:
            self._action.clock.wake(now_s)
        await self._task.ask(now_s)
        await self._action.ask(now_s)
