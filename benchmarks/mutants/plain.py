"""A plug-in of pytest: the kernels as plain Python, for which they have lost their decorators.

A kernel that is compiled anew for every mutant takes a minute, and one without its decorator is
a Python function with the same arithmetic, some hundred times slower. Three things need a
stand-in then: what compiles, the records that the compiler reads by attribute, and the clock.
"""

import ctypes
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from solver.engines.fast import clock, compiled, derivatives, layout

_PACKAGE = "solver.engines.fast."
_LIBC = ctypes.CDLL(None)


class Record(np.void):  # type: ignore[misc] # final in the stubs, not in fact
    """An element of a table whose fields are attributes, also `sum` and `base`."""

    def __getattribute__(self, name: str) -> Any:
        try:
            return np.void.__getitem__(self, name)
        except ValueError:
            return super().__getattribute__(name)

    def __setattr__(self, name: str, value: Any) -> None:
        self[name] = value


def pytest_configure() -> None:
    """Exchange them in every module of the engine that has imported them."""
    records = [kind for kind in vars(layout).values() if isinstance(kind, np.dtype)]
    exchanged: dict[int, Any] = {id(kind): np.dtype((Record, kind)) for kind in records}
    exchanged[id(compiled.compile_cached)] = _as_it_is
    exchanged[id(compiled.unchecked)] = _unchanged
    exchanged[id(clock._clock_gettime)] = _clock_gettime
    for module in [m for name, m in sys.modules.items() if name.startswith(_PACKAGE)]:
        for name, value in list(vars(module).items()):
            if id(value) in exchanged:
                setattr(module, name, exchanged[id(value)])
    compiled.compiled.cache_clear()
    compiled.entry.cache_clear()
    derivatives._compiled.cache_clear()
    np.seterr(all="ignore")


def _as_it_is(function: Callable[..., Any], signature: object) -> Callable[..., Any]:
    """Stand in for the compiler."""
    return function


def _unchanged(function: Callable[..., Any]) -> Callable[..., Any]:
    """Stand in for the way round the compiler's look at types."""
    return function


def _clock_gettime(clock_id: np.int32, timespec: Any) -> int:
    """Stand in for the compiler's call of the same function of the C library."""
    return int(_LIBC.clock_gettime(int(clock_id), ctypes.c_void_p(timespec.data)))
