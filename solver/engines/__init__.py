"""The engines, by the names people choose them by.

`fast` needs Numba, `sqp` and `ipopt` need CasADi; an engine's libraries are imported when it is
created and not before.
"""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    # Who only asks for a name or for the error does not pay for the vocabulary.
    from solver.problem import Engine

_CLASSES = {
    "fast": ("solver.engines.fast", "FastEngine"),
    "sqp": ("solver.engines.sqp", "SqpEngine"),
    "ipopt": ("solver.engines.ipopt", "IpoptEngine"),
}
DEFAULT = "default"

_MACHINE_CODE = {"fast": ("solver.engines.fast.compiled", "compiled")}
"""What loads an engine's compiled routine, or compiles it where no cache is found."""


class EngineUnavailable(Exception):
    """Raised when an engine does not exist or cannot run on this machine."""


def names() -> tuple[str, ...]:
    """Return the names of all engines, the preferred one first."""
    return tuple(_CLASSES)


def create(name: str) -> "Engine":
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


def preload(name: str) -> None:
    """Load an engine's libraries, and the machine code that its first solve would load.

    `name` may be DEFAULT, for the engine to use where nobody chose one.

    Raises:
        EngineUnavailable: As for `create`.
    """
    name = default_engine() if name == DEFAULT else name
    create(name)
    if name in _MACHINE_CODE:
        module, attribute = _MACHINE_CODE[name]
        getattr(import_module(module), attribute)()


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
