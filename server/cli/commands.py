"""The commands by name. Each is imported when it is asked for: `run` must not wait for the others.

A start imports what it needs and no more; tests/server/cli/test_imports.py holds it to that.
"""

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any, Final

import typer
from typer.core import TyperGroup
from typer.main import get_command

PLACES: Final = {
    "run": ("server.cli.run", "run"),
    "serve": ("server.cli.serve", "serve"),
    "sim": ("server.cli.simulate", "sim"),
    "router": ("server.cli.router", "router"),
    "mock-llm": ("server.cli.mock", "mock_llm"),
    "replay": ("server.cli.recordings", "replay"),
    "report": ("server.cli.recordings", "report"),
    "script": ("server.cli.script", "script"),
    "doctor": ("server.cli.doctor", "doctor"),
    "vehicle": ("server.cli.vehicle", "vehicle"),
    "experiment": ("server.cli.experiments", "experiment"),
}
"""Module and attribute of every command, in the order that the help lists them."""


class Commands(Mapping[str, Any]):
    """Every command, made when it is looked up, and once."""

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        """Return a command. Raises KeyError."""
        if name not in self._made:
            module, attribute = PLACES[name]
            self._made[name] = _command(name, getattr(import_module(module), attribute))
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(PLACES)

    def __len__(self) -> int:
        return len(PLACES)

    def __contains__(self, name: object) -> bool:
        # Mapping would look the command up, and import it.
        return name in PLACES


class CommandGroup(TyperGroup):
    """The group of all commands."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given | {"commands": Commands()})


def _command(name: str, found: Any) -> Any:
    """Return a function, or a group of its own, as a command of this name."""
    group = found
    if not isinstance(found, typer.Typer):
        group = typer.Typer(add_completion=False)
        group.command(name)(found)
    command = get_command(group)
    command.name = name
    return command
