"""Which loops advise a live mission, by who its adviser is."""

from collections.abc import Callable

from llm.chat import LanguageModel
from llm.prompts import Loop
from server.advice import Advisors
from server.exact import ExactSolver
from server.live.consulting import AdviceLoop, ModelLoop, Pace, SolverLoop
from server.live.council import LiveCouncil
from server.live.herald import Herald
from server.loops import LoopClock
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
    kinds = {Loop.TASK: (task, advisors.task), Loop.ACTION: (action, advisors.action)}
    return {
        loop: ModelLoop(pace, adviser, timeout_s, consult, snapshot, council.decide, herald.outcome)
        for loop, (pace, consult) in kinds.items()
    }
