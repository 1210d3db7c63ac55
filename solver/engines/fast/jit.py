"""How kernels are compiled: one machine-code routine, no Python inside, no fast maths.

Helpers are typed and compiled together with the routine that calls them, so only that
routine carries an explicit signature and is cached (see `compiled.py`). Division follows
numpy (no exceptions), the interpreter's lock is released.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
_BORROWING: dict[str, Any] = {**_OPTIONS, "_nrt": False}

_Function = TypeVar("_Function", bound=Callable[..., object])


def kernel(function: _Function) -> _Function:
    """Mark a function that works on arrays it is given and makes none.

    It is compiled without reference counts: its caller holds the arrays.
    """
    return cast(_Function, numba.njit(**_BORROWING)(function))


def maker(function: _Function) -> _Function:
    """Mark a function that makes arrays."""
    return cast(_Function, numba.njit(**_OPTIONS)(function))


def inlined(function: _Function) -> _Function:
    """Mark a small function that is always expanded where it is called."""
    return cast(
        _Function,
        numba.njit(**_BORROWING, forceinline=True)(function),
    )


def merged(function: _Function) -> _Function:
    """Mark a function with one caller that becomes a part of it before any compiling.

    Every function compiled on its own is optimised again with each of its callers, so layers
    cost compiling time.
    """
    return cast(_Function, numba.njit(**_OPTIONS, inline="always")(function))
