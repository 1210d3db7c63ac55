"""The monotonic clock, readable inside a kernel."""

import time
from math import inf
from typing import Any

import numpy as np
from numba import types

from solver.arrays import IntArray
from solver.engines.fast.jit import inlined

_CLOCK = time.CLOCK_MONOTONIC
_clock_gettime: Any = types.ExternalFunction(
    "clock_gettime", types.int32(types.int32, types.voidptr)
)


@inlined
def is_past(deadline: float, timespec: IntArray) -> bool:
    """Return whether a time on that clock is over; infinity never is."""
    return deadline < inf and now(timespec) > deadline


@inlined
def now(timespec: IntArray) -> float:
    """Return seconds on CLOCK_MONOTONIC, as `time.monotonic` does.

    `timespec` is scratch of shape (2,), int64.
    """
    _clock_gettime(np.int32(_CLOCK), timespec.ctypes)
    return float(timespec[0] + 1e-9 * timespec[1])
