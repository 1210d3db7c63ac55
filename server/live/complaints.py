"""When a model that gives no valid answer is worth a word: a new cause, and now and then.

Every refusal is an event of its own with its reasons. What is told here is the trouble as a
whole, which must not fill an operator's list every five seconds while a model is dead.
"""

import re
from dataclasses import dataclass

REMINDER_S = 60.0
MOST_CAUSES = 8

_FIGURES = re.compile(r"\d+(?:\.\d+)?")


@dataclass(slots=True)
class _Trouble:
    """One loop without a valid answer."""

    calls: int
    told_s: float
    causes: set[str]


class Complaints:
    """Owner of what has been told of each loop's troubles. Times are mission seconds."""

    def __init__(self) -> None:
        self._troubles: dict[str, _Trouble] = {}

    def failed(self, loop: str, cause: str, now_s: float) -> int | None:
        """Count a call without a valid answer.

        Returns how many calls in a row there were, None where people know already.
        """
        cause = _FIGURES.sub("#", cause)
        trouble = self._troubles.get(loop)
        if trouble is None:
            self._troubles[loop] = _Trouble(1, now_s, {cause})
            return 1
        trouble.calls += 1
        known = cause in trouble.causes or len(trouble.causes) >= MOST_CAUSES
        if known and now_s - trouble.told_s < REMINDER_S:
            return None
        trouble.causes.add(cause)
        trouble.told_s = now_s
        return trouble.calls

    def mended(self, loop: str) -> int:
        """Take note of a valid answer; return how many calls in a row had failed before."""
        trouble = self._troubles.pop(loop, None)
        return 0 if trouble is None else trouble.calls
