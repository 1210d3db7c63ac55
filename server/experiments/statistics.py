"""Means with 95 % intervals, and differences paired over seeds.

Two policies under one seed meet the same world and the same dice, so what tells them apart is
the mean of the differences per seed: its interval is far narrower than those of the means.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.special import stdtrit

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean and how sure it is."""

    mean: float
    half_width: float | None
    """Half the 95 % interval (Student's t); None for a single value."""

    count: int

    @property
    def lower(self) -> float:
        """Lower end of the interval, -inf for a single value."""
        return self.mean - self._reach

    @property
    def upper(self) -> float:
        """Upper end of the interval, inf for a single value."""
        return self.mean + self._reach

    @property
    def _reach(self) -> float:
        return math.inf if self.half_width is None else self.half_width


def estimate(values: Sequence[float]) -> Estimate | None:
    """Return the mean of independent values with its interval, None of no values."""
    count = len(values)
    if count == 0:
        return None
    mean = statistics.fmean(values)
    if count == 1:
        return Estimate(mean, None, 1)
    quantile = float(stdtrit(count - 1, 0.5 + 0.5 * CONFIDENCE))
    return Estimate(mean, quantile * statistics.stdev(values) / math.sqrt(count), count)


def paired(first: Mapping[int, float], second: Mapping[int, float]) -> Estimate | None:
    """Return the mean difference first - second over the seeds that both have."""
    return estimate([first[seed] - second[seed] for seed in sorted(first.keys() & second.keys())])
