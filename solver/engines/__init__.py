"""The engines, by the names people choose them by.

`fast` needs Numba, `sqp` and `ipopt` need CasADi; an engine's libraries are imported when it is
created and not before.
"""

from collections.abc import Callable
from importlib import import_module

from solver.problem import Engine

_CLASSES = {
    "fast": ("solver.engines.fast", "FastEngine"),
    "sqp": ("solver.engines.sqp", "SqpEngine"),
    "ipopt": ("solver.engines.ipopt", "IpoptEngine"),
}


class EngineUnavailable(Exception):
    """Raised when an engine does not exist or cannot run on this machine."""


def names() -> tuple[str, ...]:
    """Return the names of all engines, the preferred one first."""
    return tuple(_CLASSES)


def create(name: str) -> Engine:
    """Return a new engine.

    Raises:
        EngineUnavailable: There is no engine of this name, or its libraries are missing.
    """
    if name not in _CLASSES:
        raise EngineUnavailable(f"no engine {name!r}: choose one of {', '.join(_CLASSES)}")
    module, attribute = _CLASSES[name]
    try:
        build: Callable[[], Engine] = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise EngineUnavailable(f"engine {name!r} cannot run here: {error}") from error
    return build()


def default_engine() -> str:
    """Return the name of the engine to use where nobody chose one.

    Raises:
        EngineUnavailable: None of them can run here.
    """
    for name in _CLASSES:
        try:
            create(name)
        except EngineUnavailable:
            continue
        return name
    raise EngineUnavailable("neither numba nor casadi is installed")
