"""A drift-free schedule: ticks lie on a grid, late ones are skipped and counted. Sans-I/O."""

import math


class Schedule:
    """Says when the next tick is due. Tick k is due at `start_s` + k * `period_s`."""

    def __init__(self, period_s: float, start_s: float) -> None:
        self.period_s = period_s
        self._start_s = start_s
        self._next = 0

    @property
    def due_s(self) -> float:
        """When the next tick is due, on the clock of `start_s`."""
        return self._start_s + self._next * self.period_s

    def advance(self, now_s: float) -> int:
        """Go on from a tick that has ended; return how many ticks are skipped as late.

        A tick is late when the following one is due already: it would only tread on its heels.
        """
        behind = math.floor((now_s - self._start_s) / self.period_s + 1e-9)
        skipped = max(0, behind - self._next)
        self._next += 1 + skipped
        return skipped
