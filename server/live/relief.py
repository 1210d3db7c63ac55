"""Our own solver in the place of a task model that has fallen silent, live."""

import asyncio
from collections.abc import Callable
from typing import Final

from llm.chat import LanguageModel
from server.advice import Relief
from server.exact import ExactSolver
from server.gate.decisions import Decision
from server.live.consulting import Pace, Propose, SolverLoop
from server.loops import LoopClock
from server.mission.setup import MissionSetup
from solver.snapshot import Snapshot

NEVER_S: Final = 1e9
"""Period of what is only done when it is woken."""


class StandIn:
    """Owner of the loop that assigns while the task model is silent."""

    def __init__(self, loop: SolverLoop, relief: Relief) -> None:
        self._loop = loop
        self._relief = relief

    def note(self, card: Decision) -> None:
        """Take note of a decision: a valid answer ends the silence."""
        self._relief.note(card)

    def look(self, now_s: float) -> None:
        """Let mission time pass."""
        if self._relief.due(now_s):
            self._loop.wake()

    async def run(self, flying: asyncio.Event) -> None:
        """Assign whenever it is due, for ever."""
        await self._loop.run(flying)


def stand_in(
    adviser: LanguageModel | ExactSolver | None,
    setup: MissionSetup,
    snapshot: Callable[[], Snapshot],
    propose: Propose,
    now: Callable[[], float],
) -> StandIn | None:
    """Return who stands in for an adviser; None where no model is asked."""
    if adviser is None or isinstance(adviser, ExactSolver):
        return None
    pace = Pace(LoopClock(NEVER_S, now() + NEVER_S), now)
    loop = SolverLoop(pace, ExactSolver(setup), snapshot, propose)
    return StandIn(loop, Relief(setup.loops.task_period_s, max(0.0, snapshot().time_s)))
