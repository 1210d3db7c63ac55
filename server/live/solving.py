"""The solve in a thread of its own, with an end to patience.

An engine that hangs in native code cannot be stopped. So the tick waits for it as long as it can
afford and no longer: then the last plan goes on (or the team brakes), tick after tick, until
the engine comes back. Its late answer is thrown away.
"""

import asyncio
import time
from dataclasses import replace
from typing import Protocol, Self

import numpy as np
import structlog

from server.live.threads import WorkThread
from server.mission.tape import Committed, LatePlan
from solver.arrays import frozen
from solver.planner import Planner
from solver.problem import Budget, Problem, Rung, Solution

log = structlog.get_logger(__name__)


class Solver(Protocol):
    """Solves a tick's problem in time, whatever happens."""

    async def solve(self, problem: Problem, budget: Budget, patience_s: float) -> Solution:
        """Return a solution after at most `patience_s`. Never raises."""
        ...


class Resolver:
    """Solves the ticks of a tape the way they were solved live (`server.mission.tape.replay`)."""

    def __init__(self, planner: Planner, iterations: int) -> None:
        self._planner = planner
        self._iterations = iterations

    def __call__(self, problem: Problem, recorded: Committed) -> Solution:
        """Solve again; take the plan that wall time cut short; fall back where there was none."""
        if recorded.plan is not None:
            return _cut_short(problem, recorded, recorded.plan)
        if recorded.rung in (Rung.SHIFTED, Rung.BRAKE) and recorded.iterations == 0:
            return self._planner.carry_on(problem)
        return self._planner.solve(problem, Budget(iterations=self._iterations))


def timed(planner: Planner, problem: Problem, budget: Budget) -> Solution:
    """Solve, and mark the solution as late where the budget's time may have ended it.

    Whoever is done before the deadline has never seen it pass. The engine's time starts to run
    later than ours, so that no solution is taken for punctual that is not.
    """
    began_s = time.monotonic()
    solution = planner.solve(problem, budget)
    if budget.deadline_s is None or time.monotonic() - began_s < budget.deadline_s:
        return solution
    return replace(solution, late=True)


def _cut_short(problem: Problem, recorded: Committed, plan: LatePlan) -> Solution:
    """Return the solution of a solve that was late, as it was recorded."""
    shape = (len(problem.robot_ids), max(problem.horizon, 1), 2)
    return Solution(
        robot_ids=problem.robot_ids,
        controls=frozen(np.array(plan.controls, dtype=float).reshape(shape)),
        positions=frozen(np.array(plan.positions, dtype=float).reshape(shape)),
        velocities=frozen(np.array(plan.velocities, dtype=float).reshape(shape)),
        objective=plan.objective,
        rung=recorded.rung,
        iterations=recorded.iterations,
        solve_s=0.0,
        engine="recorded",
        late=True,
    )


class SolveThread:
    """Solves one problem at a time beside the event loop. Use it as a context."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._thread = WorkThread("solve")
        self._busy = False
        self.stuck = 0
        """Solves that were not waited for to the end."""

    def __enter__(self) -> Self:
        self._thread.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self._thread.__exit__(*exception)

    async def solve(self, problem: Problem, budget: Budget, patience_s: float) -> Solution:
        """Return the planner's solution, or its last plan after `patience_s`. Never raises."""
        if self._busy:
            return self._planner.carry_on(problem)
        answer: asyncio.Future[Solution] = asyncio.get_running_loop().create_future()

        def deliver(solution: Solution) -> None:
            self._busy = False
            if not answer.done():
                answer.set_result(solution)

        self._busy = True
        self._thread.submit(lambda: timed(self._planner, problem, budget), deliver)
        try:
            async with asyncio.timeout(patience_s):
                return await answer
        except TimeoutError:
            self.stuck += 1
            words = "a plan was not ready in time; the last one is flown on"
            log.warning(words, patience_s=round(patience_s, 3), times=self.stuck)
            return self._planner.carry_on(problem)
