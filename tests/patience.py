"""How long a test waits for what takes longer on a machine that has other things to do."""

import os

PATIENCE_S = 120.0
"""How long a test waits for what must come. Only one that fails waits so long: no figure is tested
by it, and half the time-out of a test is enough for the busiest machine."""

HOLD_S = 1.0
"""Within so long a vehicle must be holding."""

LOAD_S = 1.0
"""What a machine may add that has nothing else to do; `patience_s` for one that has."""


def busy() -> float:
    """Return how many times longer everything may take here now than on an idle machine."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def patience_s() -> float:
    """Return within what time a vehicle must be holding."""
    return HOLD_S + LOAD_S * busy()
