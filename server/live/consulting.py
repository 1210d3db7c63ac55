"""One model's loop, live: ask, verify, propose, rest; woken early by events.

At most one call is in flight. Nothing that happens here can hold up a tick: the loop lives on
the event loop between ticks, and its proposals enter the core at a tick's beginning.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

import structlog

from llm.chat import LanguageModel, ModelError
from llm.consultation import Accepted, Consultation, GivenUp, Outcome, Retry
from server.advice import tally_outcome
from server.loops import LoopClock, LoopMeter
from server.result import LoopTally
from solver.directives import Proposal, Verdict
from solver.snapshot import Snapshot

log = structlog.get_logger(__name__)

IDLE_S: Final = 3600.0

Propose = Callable[[Proposal], Awaitable[Verdict]]
Tell = Callable[[Consultation, Outcome, Verdict | None], None]


class ModelLoop:
    """Paces and counts the calls of one model. Times are on the monotonic clock given."""

    def __init__(
        self,
        clock: LoopClock,
        model: LanguageModel,
        timeout_s: float,
        consult: Callable[[], Consultation],
        snapshot: Callable[[], Snapshot],
        propose: Propose,
        tell: Tell,
        now: Callable[[], float],
    ) -> None:
        self.meter = LoopMeter(window=20)
        self.tally = LoopTally()
        self._clock = clock
        self._model = model
        self._timeout_s = timeout_s
        self._consult = consult
        self._snapshot = snapshot
        self._propose = propose
        self._tell = tell
        self._now = now
        self._woken = asyncio.Event()

    def wake(self) -> None:
        """Ask for a call soon."""
        self._clock.wake(self._now())
        self._woken.set()

    async def run(self, flying: asyncio.Event) -> None:
        """Call for ever; only while `flying` is set are new calls begun."""
        while True:
            await self._rest()
            await flying.wait()
            await self._call()

    async def _rest(self) -> None:
        """Wait until a call is due."""
        while not self._clock.due(self._now()):
            self._woken.clear()
            due_s = self._clock.due_s
            rest_s = IDLE_S if due_s is None else max(0.0, due_s - self._now())
            try:
                async with asyncio.timeout(rest_s):
                    await self._woken.wait()
            except TimeoutError:
                continue

    async def _call(self) -> None:
        """Run one consultation to its end and count it."""
        began_s = self._now()
        self._clock.started(began_s)
        try:
            consultation = self._consult()
            outcome = await self._outcome(consultation)
            verdict = None
            if isinstance(outcome, Accepted):
                verdict = await self._propose(outcome.proposal)
        except Exception:  # a fault in handling an answer must not end the flight
            log.exception("the model loop failed on an answer")
            self.meter.record(self._now(), self._now() - began_s, success=False)
        else:
            adopted = verdict is not None and verdict.accepted
            self.meter.record(self._now(), self._now() - began_s, success=adopted)
            tally_outcome(self.tally, consultation, adopted=adopted)
            self.tally.latencies_s.append(self._now() - began_s)
            self._tell(consultation, outcome, verdict)
        finally:
            self._clock.finished(self._now())

    async def _outcome(self, consultation: Consultation) -> Accepted | GivenUp:
        """Ask until an answer is accepted or there are no tries left."""
        while True:
            try:
                reply = await self._model.complete(consultation.request, self._timeout_s)
            except ModelError as error:
                outcome = consultation.fail(error)
            else:
                outcome = consultation.receive(reply, self._snapshot())
            if not isinstance(outcome, Retry):
                return outcome
