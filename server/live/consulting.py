"""One model's loop, live: ask, verify, propose, rest; woken early by events.

At most one call is in flight. Nothing that happens here can hold up a tick: the loop lives on
the event loop between ticks, and its proposals enter the core at a tick's beginning.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final, Protocol

import structlog

from llm.chat import LanguageModel, ModelError
from llm.consultation import Accepted, Consultation, GivenUp, Outcome, Retry
from server.advice import tally_outcome
from server.exact import ExactSolver
from server.loops import LoopClock, LoopMeter
from server.result import LoopTally
from solver.directives import Proposal, Verdict
from solver.snapshot import Snapshot

log = structlog.get_logger(__name__)

IDLE_S: Final = 3600.0

Propose = Callable[[Proposal], Awaitable[Verdict]]
Tell = Callable[[Consultation, Outcome, Verdict | None], None]


class Pace:
    """When one loop may go on, on a monotonic clock; woken early by events."""

    def __init__(self, clock: LoopClock, now: Callable[[], float]) -> None:
        self.clock = clock
        self.now = now
        self._woken = asyncio.Event()

    def wake(self) -> None:
        """Ask for a call soon."""
        self.clock.wake(self.now())
        self._woken.set()

    async def rest(self) -> None:
        """Wait until a call is due."""
        while not self.clock.due(self.now()):
            self._woken.clear()
            due_s = self.clock.due_s
            rest_s = IDLE_S if due_s is None else max(0.0, due_s - self.now())
            try:
                async with asyncio.timeout(rest_s):
                    await self._woken.wait()
            except TimeoutError:
                continue


class AdviceLoop(Protocol):
    """One of the loops that advise a live mission."""

    meter: LoopMeter
    tally: LoopTally

    def wake(self) -> None:
        """Ask for advice soon."""
        ...

    async def run(self, flying: asyncio.Event) -> None:
        """Advise for ever; only while `flying` is set is anything new begun."""
        ...


class SolverLoop:
    """Our own assignment solver at the task model's period, in a thread of its own."""

    def __init__(
        self,
        pace: Pace,
        solver: ExactSolver,
        snapshot: Callable[[], Snapshot],
        propose: Propose,
    ) -> None:
        self.meter = LoopMeter(window=20)
        self.tally = LoopTally()
        self._pace = pace
        self._solver = solver
        self._snapshot = snapshot
        self._propose = propose
        self._count = 0

    def wake(self) -> None:
        """Ask for an assignment soon."""
        self._pace.wake()

    async def run(self, flying: asyncio.Event) -> None:
        """Assign for ever; only while `flying` is set is a solve begun."""
        while True:
            await self._pace.rest()
            await flying.wait()
            await self._assign()

    async def _assign(self) -> None:
        began_s = self._pace.now()
        self._pace.clock.started(began_s)
        self._count += 1
        try:
            proposal = await asyncio.to_thread(
                self._solver.propose, self._snapshot(), f"x{self._count}"
            )
            verdict = await self._propose(proposal)
        except Exception:  # a fault of the solver must not end the flight
            log.exception("the assignment solver failed")
            self.meter.record(self._pace.now(), self._pace.now() - began_s, success=False)
        else:
            duration_s = self._pace.now() - began_s
            self.meter.record(self._pace.now(), duration_s, success=verdict.accepted)
        finally:
            self._pace.clock.finished(self._pace.now())


class ModelLoop:
    """Paces and counts the calls of one model. Times are on the monotonic clock given."""

    def __init__(
        self,
        pace: Pace,
        model: LanguageModel,
        timeout_s: float,
        consult: Callable[[], Consultation],
        snapshot: Callable[[], Snapshot],
        propose: Propose,
        tell: Tell,
    ) -> None:
        self.meter = LoopMeter(window=20)
        self.tally = LoopTally()
        self._pace = pace
        self._model = model
        self._timeout_s = timeout_s
        self._consult = consult
        self._snapshot = snapshot
        self._propose = propose
        self._tell = tell

    def wake(self) -> None:
        """Ask for a call soon."""
        self._pace.wake()

    async def run(self, flying: asyncio.Event) -> None:
        """Call for ever; only while `flying` is set are new calls begun."""
        while True:
            await self._pace.rest()
            await flying.wait()
            await self._call()

    async def _call(self) -> None:
        """Run one consultation to its end and count it."""
        began_s = self._pace.now()
        self._pace.clock.started(began_s)
        try:
            consultation = self._consult()
            outcome = await self._outcome(consultation)
            verdict = None
            if isinstance(outcome, Accepted):
                verdict = await self._propose(outcome.proposal)
        except Exception:  # a fault in handling an answer must not end the flight
            log.exception("the model loop failed on an answer")
            self.meter.record(self._pace.now(), self._pace.now() - began_s, success=False)
        else:
            adopted = verdict is not None and verdict.accepted
            self.meter.record(self._pace.now(), self._pace.now() - began_s, success=adopted)
            tally_outcome(self.tally, consultation, adopted=adopted)
            self.tally.latencies_s.append(self._pace.now() - began_s)
            self._tell(consultation, outcome, verdict)
        finally:
            self._pace.clock.finished(self._pace.now())

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
