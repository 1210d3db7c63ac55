"""Many durations in bounded memory: of a mission that flies for days, and goes on after a crash."""

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Final

import numpy as np

EXACT: Final = 10_000
"""So many are kept as they are."""

_WIDTH: Final = math.log(1.02)
_LEAST_S: Final = 1e-9


@dataclass(slots=True)
class Durations:
    """Durations in seconds. Quantiles are exact up to `EXACT` of them, then to one per cent.

    Beyond that only the bins say how they are distributed: bins 2 % wide on a logarithmic scale,
    told of by their geometric middle.
    """

    bins: dict[int, int] = field(default_factory=Counter)
    """How many lie in which bin; all that outlives a process, with `longest_s`."""

    longest_s: float = 0.0
    count: int = 0
    _exact: list[float] = field(default_factory=list)

    @classmethod
    def restored(cls, bins: dict[int, int], longest_s: float) -> "Durations":
        """Return what was kept of another process's durations."""
        return cls(Counter(bins), longest_s, sum(bins.values()))

    def add(self, duration_s: float) -> None:
        """Count one."""
        if self.count == len(self._exact) < EXACT:
            self._exact.append(duration_s)
        self.count += 1
        self.longest_s = max(self.longest_s, duration_s)
        number = round(math.log(max(duration_s, _LEAST_S)) / _WIDTH)
        self.bins[number] = self.bins.get(number, 0) + 1

    def quantile_s(self, share: float) -> float | None:
        """Return the duration that `share` (0 to 1) of all do not exceed, None without any."""
        if not self.count:
            return None
        if len(self._exact) == self.count:
            return float(np.quantile(self._exact, share))
        rank, below = share * (self.count - 1), 0
        for number in sorted(self.bins):
            below += self.bins[number]
            if below > rank:
                return min(math.exp(number * _WIDTH), self.longest_s)
        return self.longest_s


@dataclass(slots=True)
class Average:
    """The mean of many numbers, kept as a sum."""

    total: float = 0.0
    count: int = 0

    def add(self, value: float) -> None:
        """Count one."""
        self.total += value
        self.count += 1

    def plus(self, other: "Average") -> "Average":
        """Return the average of both together."""
        return Average(self.total + other.total, self.count + other.count)

    @property
    def mean(self) -> float | None:
        """The mean, None of nothing."""
        return self.total / self.count if self.count else None
