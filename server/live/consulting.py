"""One model's loop, live: ask, verify, propose, rest; woken early by events.

At most one call is in flight. Nothing that happens here can hold up a tick: the loop lives on
the event loop between ticks, and its proposals enter the core at a tick's beginning.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from typing import Final, Protocol

import structlog

from llm.chat import LanguageModel, ModelError
from llm.consultation import Accepted, Consultation, GivenUp, Outcome, Retry
from server.advice import Ask, tally_outcome
from server.exact import ExactSolver
from server.gate.decisions import Decision
from server.gate.decisions import Loop as CardLoop
from server.loops import LoopClock, LoopMeter
from server.result import LoopTally
from solver.directives import Proposal
from solver.snapshot import Snapshot

log = structlog.get_logger(__name__)

IDLE_S: Final = 3600.0

Propose = Callable[[Proposal], Awaitable[Decision]]
Decide = Callable[[Consultation, Accepted | GivenUp], Awaitable[Decision]]
Tell = Callable[[Consultation, Outcome, Decision], None]


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
    voice: CardLoop
    """Under whose name its proposals come before the gate."""

    def wake(self) -> None:
        """Ask for advice soon."""
        ...

    async def run(self, flying: asyncio.Event) -> None:
        """Advise for ever; only while `flying` is set is anything new begun."""
        ...


class _PacedLoop(ABC):
    """What every loop that advises does between its turns. Satisfies `AdviceLoop`."""

    def __init__(self, pace: Pace, voice: CardLoop) -> None:
        self.voice = voice
        self.meter = LoopMeter(window=20)
        self.tally = LoopTally()
        self._pace = pace

    def wake(self) -> None:
        """Ask for advice soon."""
        self._pace.wake()

    async def run(self, flying: asyncio.Event) -> None:
        """Advise for ever; only while `flying` is set is anything new begun."""
        while True:
            await self._pace.rest()
            await flying.wait()
            await self._advise()

    @abstractmethod
    async def _advise(self) -> None:
        """Give advice once, and count it."""

    def _count_answer(self, began_s: float, *, success: bool) -> float:
        """Count the end of a call; return how long it took, seconds."""
        now_s = self._pace.now()
        self.meter.record(now_s, now_s - began_s, success=success)
        return now_s - began_s


class SolverLoop(_PacedLoop):
    """Our own assignment solver at the task model's period, in a thread of its own."""

    def __init__(
        self,
        pace: Pace,
        solver: ExactSolver,
        snapshot: Callable[[], Snapshot],
        propose: Propose,
    ) -> None:
        super().__init__(pace, CardLoop.SOLVER)
        self._solver = solver
        self._snapshot = snapshot
        self._propose = propose
        self._count = 0

    async def _advise(self) -> None:
        began_s = self._pace.now()
        self._pace.clock.started(began_s)
        self._count += 1
        solved = False
        try:
            proposal = await asyncio.to_thread(
                self._solver.propose, self._snapshot(), f"x{self._count}"
            )
            solved = True
            self._count_answer(began_s, success=True)
            card = await self._propose(proposal)
            self.meter.decided(adopted=card.accepted)
        except Exception:  # a fault of the solver must not end the flight
            log.exception("the assignment solver failed")
            if not solved:
                self._count_answer(began_s, success=False)
        finally:
            self._pace.clock.finished(self._pace.now())


class ModelLoop(_PacedLoop):
    """Paces and counts the calls of one model. Times are on the monotonic clock given."""

    def __init__(
        self,
        pace: Pace,
        voice: CardLoop,
        model: LanguageModel,
        timeout_s: float,
        consult: Callable[[], Ask],
        snapshot: Callable[[], Snapshot],
        decide: Decide,
        tell: Tell,
    ) -> None:
        super().__init__(pace, voice)
        self._model = model
        self._timeout_s = timeout_s
        self._consult = consult
        self._snapshot = snapshot
        self._decide = decide
        self._tell = tell

    async def _advise(self) -> None:
        """Run one consultation to its end and count it."""
        began_s = self._pace.now()
        self._pace.clock.started(began_s)
        latency_s: float | None = None
        try:
            # Words for a large team take longer than the event loop may be held up.
            consultation = await asyncio.to_thread(self._consult())
            outcome = await self._outcome(consultation)
            # The answer is counted when it is there; gate and people may take long to decide.
            latency_s = self._count_answer(began_s, success=isinstance(outcome, Accepted))
            card = await self._decide(consultation, outcome)
            self.meter.decided(adopted=card.accepted)
            tally_outcome(self.tally, consultation, adopted=card.accepted)
            self.tally.latency_s.add(latency_s)
            self._tell(consultation, outcome, card)
        except Exception:  # a fault in handling an answer must not end the flight
            log.exception("the model loop failed on an answer")
            if latency_s is None:
                self._count_answer(began_s, success=False)
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
                outcome = await asyncio.to_thread(consultation.receive, reply, self._snapshot())
            if not isinstance(outcome, Retry):
                return outcome
