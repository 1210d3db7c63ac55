"""Which loops advise a live mission, by who its adviser is."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from llm.chat import LanguageModel
from llm.prompts import Loop
from server.advice import Advisors
from server.exact import ExactSolver
from server.gate.decisions import Loop as CardLoop
from server.live.consulting import AdviceLoop, ModelLoop, Pace, SolverLoop
from server.live.council import LiveCouncil
from server.live.herald import Herald
from server.loops import LoopClock, LoopReport
from server.mission.setup import LoopSetup
from solver.snapshot import Snapshot


def advice_loops(
    adviser: LanguageModel | ExactSolver | None,
    periods: LoopSetup,
    timeout_s: float,
    advisors: Advisors,
    council: LiveCouncil,
    herald: Herald,
    snapshot: Callable[[], Snapshot],
    now: Callable[[], float],
) -> dict[Loop, AdviceLoop]:
    """Return the loops of a model (both), of our solver (the task loop), or none."""
    task = Pace(LoopClock(periods.task_period_s, now()), now)
    if adviser is None:
        return {}
    if isinstance(adviser, ExactSolver):
        return {Loop.TASK: SolverLoop(task, adviser, snapshot, council.propose)}
    action = Pace(LoopClock(periods.action_period_s, now()), now)
    kinds = {
        Loop.TASK: (task, CardLoop.TASK, advisors.task),
        Loop.ACTION: (action, CardLoop.ACTION, advisors.action),
    }
    return {
        loop: ModelLoop(
            pace, voice, adviser, timeout_s, consult, snapshot, council.decide, herald.outcome
        )
        for loop, (pace, voice, consult) in kinds.items()
    }


def loop_reports(
    loops: Mapping[Loop, AdviceLoop], council: LiveCouncil, now_s: float
) -> dict[str, LoopReport]:
    """Return how the loops do, by their names on the stream."""
    return {
        f"{loop.value}_llm": replace(
            driver.meter.report(now_s), waits_for_person=council.waits_for_person(driver.voice)
        )
        for loop, driver in loops.items()
    }
