"""When a model loop may speak next, and how it has been doing. Sans-I/O, any clock.

The same clockwork paces the task and action loops live (monotonic seconds) and in
lockstep (mission seconds): DESIGN "the loops", and the paper's Table II.
"""

from collections import deque
from dataclasses import dataclass

DEBOUNCE_S = 0.3
"""Events that arrive together cause one call."""

REST_S = 1.0
"""A slow model is left alone this long after an answer."""


class LoopClock:
    """Paces one loop: periodic, at most one call in flight, woken early by events."""

    def __init__(self, period_s: float, first_s: float = 0.0) -> None:
        self.period_s = period_s
        self._due_s = first_s
        self._started_s: float | None = None
        self._finished_s: float | None = None
        self._woken = False

    @property
    def in_flight(self) -> bool:
        """Whether a call is under way."""
        return self._started_s is not None

    @property
    def due_s(self) -> float | None:
        """When the next call may start, None while one is in flight."""
        return None if self.in_flight else self._due_s

    def due(self, now_s: float) -> bool:
        """Return whether a call should start now."""
        return not self.in_flight and now_s >= self._due_s - 1e-9

    def wake(self, now_s: float) -> None:
        """Ask for a call soon: now plus the debounce, or right after the one in flight."""
        if self.in_flight:
            self._woken = True
            return
        earliest = now_s + DEBOUNCE_S
        if self._finished_s is not None:
            earliest = max(earliest, self._finished_s + DEBOUNCE_S)
        self._due_s = min(self._due_s, earliest)

    def started(self, now_s: float) -> None:
        """Note that a call has started. Raises RuntimeError when one is in flight."""
        if self.in_flight:
            raise RuntimeError("a call is in flight already")
        self._started_s = now_s
        self._woken = False

    def finished(self, now_s: float) -> None:
        """Note that the call has ended, well or badly."""
        if self._started_s is None:
            raise RuntimeError("no call is in flight")
        latency_s = now_s - self._started_s
        self._due_s = self._started_s + max(self.period_s, latency_s + REST_S)
        self._started_s = None
        self._finished_s = now_s
        if self._woken:
            self._woken = False
            self._due_s = min(self._due_s, now_s + DEBOUNCE_S)


@dataclass(frozen=True, slots=True)
class LoopReport:
    """One row of the paper's Table II."""

    calls: int
    missed: int
    rate_hz: float | None
    mean_s: float | None
    success_rate: float | None
    """Share of calls that ended well: a plan that converged, an answer that was valid."""

    age_s: float | None
    """Since the last success; None before the first."""

    adopted_rate: float | None = None
    """Share of decided calls whose answer went into force; None before the first, and for the
    optimizer, whose plans nobody decides about."""

    waits_for_person: bool = False
    """Whether its newest answer waits for a person: until then it asks for no other."""


class LoopMeter:
    """Counts one loop's calls; rate and mean over a sliding window."""

    def __init__(self, window: int = 100) -> None:
        self._ends: deque[float] = deque(maxlen=window)
        self._durations: deque[float] = deque(maxlen=window)
        self._successes: deque[bool] = deque(maxlen=window)
        self._adoptions: deque[bool] = deque(maxlen=window)
        self._last_success_s: float | None = None
        self._calls = 0
        self._missed = 0

    def record(self, end_s: float, duration_s: float, *, success: bool) -> None:
        """Count a call that ended at `end_s` after `duration_s`."""
        self._calls += 1
        self._ends.append(end_s)
        self._durations.append(duration_s)
        self._successes.append(success)
        if success:
            self._last_success_s = end_s

    def decided(self, *, adopted: bool) -> None:
        """Take note of whether a call's answer went into force, whenever that is known."""
        self._adoptions.append(adopted)

    def miss(self, count: int = 1) -> None:
        """Count calls that were due and did not happen in time."""
        self._missed += count

    def report(self, now_s: float) -> LoopReport:
        """Return the figures as of now."""
        rate = None
        if len(self._ends) > 1 and self._ends[-1] > self._ends[0]:
            rate = (len(self._ends) - 1) / (self._ends[-1] - self._ends[0])
        count, decided = len(self._durations), len(self._adoptions)
        return LoopReport(
            calls=self._calls,
            missed=self._missed,
            rate_hz=rate,
            mean_s=sum(self._durations) / count if count else None,
            success_rate=sum(self._successes) / count if count else None,
            age_s=None if self._last_success_s is None else now_s - self._last_success_s,
            adopted_rate=sum(self._adoptions) / decided if decided else None,
        )
