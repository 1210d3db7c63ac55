"""The two model loops on the virtual clock.

The question is asked from the snapshot at t; the real call is awaited at once, and its answer
is kept back until t plus the latency has come in mission time. It is verified against the
snapshot of that moment; a further try starts then, and adds its own latency.
"""

from collections.abc import Callable
from dataclasses import dataclass

from llm.chat import ChatReply, ErrorKind, LanguageModel, ModelError
from llm.consultation import Accepted, Consultation, Retry
from server.advice import Advisors, tally_outcome
from server.loops import LoopClock
from server.mission.tape import TapedCore
from server.result import LoopTally

TIMEOUT_S = 8.0
"""Longest virtual answer time of one try; real calls get the same in real seconds."""

REAL_TIMEOUT_S = 60.0
"""Longest a real call may take in lockstep; mission time stands still meanwhile."""


@dataclass(frozen=True, slots=True)
class Latency:
    """How long an answer takes in lockstep, virtual seconds; None as measured."""

    task_s: float | None
    action_s: float | None


PAPER_LATENCY = Latency(task_s=1.36, action_s=0.89)
"""The paper's Table II."""


@dataclass(slots=True)
class _Pending:
    """An answer on its way."""

    consultation: Consultation
    asked_s: float
    arrival_s: float
    answer: ChatReply | ModelError


class VirtualLoop:
    """One model's loop in virtual time: at most one answer on its way."""

    def __init__(
        self,
        clock: LoopClock,
        core: TapedCore,
        model: LanguageModel,
        consult: Callable[[], Consultation],
        latency_s: float | None,
    ) -> None:
        self.clock = clock
        self.tally = LoopTally()
        self._core = core
        self._model = model
        self._consult = consult
        self._latency_s = latency_s
        self._pending: _Pending | None = None

    async def deliver(self, now_s: float) -> None:
        """Hand over the answer that has arrived by now, if any; send a further try if need be."""
        pending = self._pending
        while pending is not None and pending.arrival_s <= now_s + 1e-9:
            self._pending = None
            consultation = pending.consultation
            if isinstance(pending.answer, ModelError):
                outcome = consultation.fail(pending.answer)
            else:
                outcome = consultation.receive(pending.answer, self._core.snapshot)
            if isinstance(outcome, Retry):
                pending = await self._send(consultation, pending.asked_s, pending.arrival_s)
                self._pending = pending
                continue
            adopted = (
                isinstance(outcome, Accepted) and self._core.propose(outcome.proposal).accepted
            )
            tally_outcome(self.tally, consultation, adopted=adopted)
            self.tally.latencies_s.append(pending.arrival_s - pending.asked_s)
            self.clock.finished(pending.arrival_s)
            pending = None

    async def ask(self, now_s: float) -> None:
        """Start a call when the loop is due."""
        if self.clock.due(now_s):
            self.clock.started(now_s)
            self._pending = await self._send(self._consult(), now_s, now_s)

    async def _send(self, consultation: Consultation, asked_s: float, sent_s: float) -> _Pending:
        answer: ChatReply | ModelError
        try:
            answer = await self._model.complete(consultation.request, REAL_TIMEOUT_S)
            latency_s = answer.latency_s if self._latency_s is None else self._latency_s
        except ModelError as error:
            answer = error
            latency_s = TIMEOUT_S if error.kind is ErrorKind.TIMEOUT else self._latency_s or 0.0
        if latency_s > TIMEOUT_S:
            answer = ModelError(ErrorKind.TIMEOUT, f"no answer within {TIMEOUT_S:g} s")
            latency_s = TIMEOUT_S
        return _Pending(consultation, asked_s, sent_s + latency_s, answer)


class VirtualAdvice:
    """Both loops of a lockstep mission."""

    def __init__(self, core: TapedCore, model: LanguageModel, latency: Latency) -> None:
        periods = core.core.setup.loops
        self._core = core
        self._advisors = Advisors(core.core)
        self._task = VirtualLoop(
            LoopClock(periods.task_period_s),
            core,
            model,
            self._advisors.task,
            latency.task_s,
        )
        self._action = VirtualLoop(
            LoopClock(periods.action_period_s),
            core,
            model,
            self._advisors.action,
            latency.action_s,
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
        if events.task:
            self._task.clock.wake(now_s)
        if events.action:
            self._action.clock.wake(now_s)
        await self._task.ask(now_s)
        await self._action.ask(now_s)
