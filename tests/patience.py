"""How long a test waits for what takes longer on a machine that has other things to do."""

import os
from time import thread_time

PATIENCE_S = 120.0
"""How long a test waits for what must come. Only one that fails waits so long: no figure is tested
by it, and half the time-out of a test is enough for the busiest machine."""

HOLD_S = 1.0
"""Within so long a vehicle must be holding."""

LOAD_S = 1.0
"""What a machine may add that has nothing else to do; `patience_s` for one that has."""

REFERENCE_S = 0.0015
"""What `slowness` computes took so long where bounds of processor time were set."""


def busy() -> float:
    """Return how many times longer everything may take here now than on an idle machine."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def slowness() -> float:
    """Return how many times longer this processor takes than the one that bounds were set on."""

    def taken_s() -> float:
        began_s, table = thread_time(), dict.fromkeys(range(97), 0)
        for number in range(20_000):
            table[number % 97] += number
        return thread_time() - began_s

    return max(1.0, min(taken_s() for _ in range(5)) / REFERENCE_S)


def patience_s() -> float:
    """Return within what time a vehicle must be holding."""
    return HOLD_S + LOAD_S * busy()
