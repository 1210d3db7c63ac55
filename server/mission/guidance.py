"""The degradation ladder: who guides the optimizer now, and how old that guidance is."""

from solver.directives import Directives, Proposal, Source, Verdict
from solver.observations import HoldState
from solver.snapshot import Guidance

_MODELS = frozenset({Source.TASK_LLM, Source.ACTION_LLM})
_SOLVERS = frozenset({Source.EXACT, Source.REPAIR})

FRESH_PERIODS = 1.5
"""A model's answer guides for this many task periods, then it is only the last valid one."""


class GuidanceLadder:
    """Owner of the time of the last valid answer."""

    def __init__(self, task_period_s: float) -> None:
        self._fresh_s = FRESH_PERIODS * task_period_s
        self.answered_s: float | None = None
        """Mission time of the last valid answer, None before the first."""

    def note(self, proposal: Proposal, verdict: Verdict, now_s: float) -> None:
        """Remember when a model last gave a valid answer."""
        if verdict.accepted and proposal.source in _MODELS:
            self.answered_s = now_s

    def level(
        self, directives: Directives, hold: HoldState, now_s: float
    ) -> tuple[Guidance, float]:
        """Return the rung in force and the age of its guidance in seconds."""
        age_s = now_s - (self.answered_s or 0.0)
        if hold is HoldState.HELD:
            return Guidance.HOLD, age_s
        if directives.assignment_source in _SOLVERS:
            return Guidance.SOLVER, now_s - directives.assignment_since_s
        if self.answered_s is not None and age_s <= self._fresh_s:
            return Guidance.MODEL, age_s
        return Guidance.LAST_VALID, age_s
