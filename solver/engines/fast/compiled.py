"""The compiled routine: made once, cached on disk, loaded in milliseconds after that.

Numba keys its cache by the file of one function and would miss a change in any helper, so the
key here is made of every source of this package (nothing else is compiled into the routine).
The processor stands in Numba's own part of the key: a cache may hold machine code for several.

The cache lies beside the sources where that directory is writable or already filled, else in
the user's cache directory; `FALCONER_CACHE_DIR` overrides both.
"""

import logging
import os
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, cast

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache

from solver.engines.fast.request import signature
from solver.engines.fast.routine import Answer, routine

CACHE_VARIABLE = "FALCONER_CACHE_DIR"
_PACKAGE = Path(__file__).parent
_log = logging.getLogger(__name__)


def source_key() -> str:
    """Return a digest of all sources that are compiled into the routine."""
    digest = sha256()
    for path in sorted(_PACKAGE.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:24]


def cache_directory(key: str) -> Path:
    """Return where machine code made from the sources of this key is kept."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen) / key
    beside = _PACKAGE / "__pycache__" / f"kernels-{key}"
    parent = beside.parent if beside.parent.exists() else _PACKAGE
    if beside.exists() or os.access(parent, os.W_OK):
        return beside
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "falconer" / key


class _Locator:
    """Numba's question where to cache a function and how old it is, answered by the key."""

    def __init__(self) -> None:
        self._key = source_key()

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> "_Locator":
        return cls()

    def get_cache_path(self) -> str:
        return str(cache_directory(self._key))

    def ensure_cache_path(self) -> None:
        Path(self.get_cache_path()).mkdir(parents=True, exist_ok=True)

    def get_source_stamp(self) -> str:
        return self._key

    def get_disambiguator(self) -> str:
        return self._key


class _Implementation(CompileResultCacheImpl):
    def __init__(self, function: Callable[..., Any]) -> None:
        self._locator_classes: list[Any] = [_Locator]
        super().__init__(function)  # type: ignore[no-untyped-call]


class _Cache(FunctionCache):
    _impl_class = _Implementation

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the machine code, None where there is none that can be read."""
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except OSError as error:
            _log.warning("cached kernels could not be read: %s", error)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the machine code; a disk that refuses costs the next start time, nothing else."""
        try:
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except OSError as error:
            _log.warning("compiled kernels could not be cached: %s", error)


def compile_cached(function: Callable[..., Any], signature: Any) -> Callable[..., Any]:
    """Return a function as machine code, from the cache or compiled now (seconds).

    Raises:
        numba.core.errors.NumbaError: It cannot be compiled on this machine.
    """
    dispatcher: Any = numba.njit(nogil=True, error_model="numpy")(function)
    dispatcher._cache = _Cache(function)  # type: ignore[no-untyped-call]
    dispatcher.compile(signature)
    dispatcher.disable_compile()
    return cast(Callable[..., Any], dispatcher)


@cache
def compiled() -> Callable[..., Answer]:
    """Return the routine, compiled once in a process."""
    return compile_cached(routine, signature())


def unchecked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return what `compile_cached` made without Numba's look at the type of each argument.

    Whoever calls it vouches that the arrays are of the signature's kinds; `packing.py` does.
    """
    dispatcher: Any = function
    (overload,) = dispatcher.overloads.values()
    return cast(Callable[..., Any], overload.entry_point)


@cache
def entry() -> Callable[..., Answer]:
    """Return the routine to be called with what `packed` returns."""
    return unchecked(compiled())
