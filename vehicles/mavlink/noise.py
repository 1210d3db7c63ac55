"""Noise on a link: when what cannot be used of it is worth a word.

Much of it at once is told, and once for as long as it lasts. Sans-I/O; times are on one monotonic
clock.
"""

from vehicles.mavlink.codec import Counts

LOOK_S = 1.0
NOISY = 10
"""So many unusable frames between two looks are no accident of a radio link."""

QUIET_S = 10.0
"""After so long without, more is told anew."""


class NoiseWatch:
    """Owner of what has been told of one link's noise."""

    def __init__(self) -> None:
        self._looked_s = float("-inf")
        self._counted = 0
        self._noisy_s: float | None = None

    def look(self, counts: Counts, now_s: float) -> str | None:
        """Return what to tell people now, None where there is nothing new.

        Frames of other systems are left out: of those a bridge tells once, whoever they are.
        """
        if now_s - self._looked_s < LOOK_S:
            return None
        self._looked_s = now_s
        counted = counts.bad + counts.oversized + counts.truncated + counts.implausible
        more, self._counted = counted - self._counted, counted
        if self._noisy_s is not None and now_s - self._noisy_s > QUIET_S:
            self._noisy_s = None
        if more < NOISY:
            return None
        known, self._noisy_s = self._noisy_s is not None, now_s
        return None if known else f"{more} frames within a second could not be used: noise"
