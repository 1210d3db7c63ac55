"""Our own assignment solver in lockstep: at the task loop's period, in no time at all."""

from server.advice import Advisors
from server.exact import ExactSolver
from server.lockstep.council import Council
from server.loops import LoopClock
from server.result import LoopTally


class ExactAdvice:
    """Asks the assignment solver where the task model would be asked. No model, no calls."""

    def __init__(self, council: Council) -> None:
        core = council.core
        self.task = LoopTally()
        self.action = LoopTally()
        self._core = core
        self._council = council
        self._solver = ExactSolver(core.core.setup)
        self._advisors = Advisors(core.core)
        self._clock = LoopClock(core.core.setup.loops.task_period_s)
        self._count = 0

    async def deliver(self, now_s: float) -> None:
        """Nothing is ever on its way."""

    async def ask(self, now_s: float) -> None:
        """Propose when the task loop is due, or a robot or target was lost or found."""
        if self._advisors.look(self._core.snapshot).task:
            self._clock.wake(now_s)
        if not self._clock.due(now_s):
            return
        self._clock.started(now_s)
        self._count += 1
        self._council.propose(self._solver.propose(self._core.snapshot, f"x{self._count}"))
        self._clock.finished(now_s)
