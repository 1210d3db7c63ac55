"""What the product really offers: commands, settings and routes, read off the running code."""

from collections.abc import Iterator
from functools import cache
from typing import Any, cast

import typer
from fastapi import FastAPI
from fastapi.routing import APIWebSocketRoute, iter_route_contexts
from pydantic_settings import BaseSettings
from starlette.routing import Mount
from typer.core import TyperGroup
from typer.exceptions import TyperException
from typer.main import get_command

from server.api.app import create_app
from server.api.service import MissionService
from server.settings import Settings
from tests.house.documents import Route


class UnparsableError(Exception):
    """Raised when a command line does not fit the commands."""


def commands(app: typer.Typer) -> dict[str, Any]:
    """Return every command by its full name ("run", "experiment ablation")."""

    def walk(group: Any, prefix: str) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for name, command in group.commands.items():
            full_name = f"{prefix}{name}"
            if isinstance(command, TyperGroup):
                found |= walk(command, f"{full_name} ")
            else:
                found[full_name] = command
        return found

    return walk(get_command(app), "")


def parameters(command: Any) -> set[str]:
    """Return a command's arguments (as METAVAR) and the longest spelling of its options."""
    names: set[str] = set()
    for parameter in command.params:
        if parameter.param_type_name == "argument":
            names.add((parameter.metavar or parameter.name).upper())
        elif parameter.name != "help":
            names.add(max(parameter.opts, key=len))
    return names


def parse(app: typer.Typer, line: list[str]) -> None:
    """Parse a command line without running it. Raises UnparsableError."""
    command: Any = get_command(app)
    context: Any = None
    arguments = list(line)
    try:
        while isinstance(command, TyperGroup) and arguments and arguments[0] in command.commands:
            context = command.make_context("falconer", arguments[:1], parent=context)
            command = command.commands[arguments.pop(0)]
        if isinstance(command, TyperGroup) and arguments and not arguments[0].startswith("-"):
            raise UnparsableError(f"no command {arguments[0]}")
        if arguments or not isinstance(command, TyperGroup):
            command.make_context("falconer", arguments, parent=context)
    except typer.Exit as end:
        if end.exit_code:
            raise UnparsableError(f"falconer {' '.join(line)} would fail") from end
    except TyperException as error:
        raise UnparsableError(str(error)) from error


def settings(model: type[BaseSettings]) -> list[str]:
    """Return the environment variable of every setting."""
    prefix = model.model_config.get("env_prefix", "")
    return [f"{prefix}{name}".upper() for name in model.model_fields]


@cache
def routes() -> frozenset[Route]:
    """Return every route of the server without a console, WebSockets included."""
    nobody_asks = cast(MissionService, object())
    return frozenset(_routes_of(create_app(Settings(), nobody_asks), ""))


def _routes_of(app: Any, prefix: str) -> Iterator[Route]:
    """Yield the routes of an application and of those mounted in it."""
    for path, operations in app.openapi()["paths"].items():
        for method in operations:
            yield Route(method.upper(), f"{prefix}{path}")
    for context in iter_route_contexts(app.routes):
        route = context.original_route
        if isinstance(route, Mount) and isinstance(route.app, FastAPI):
            yield from _routes_of(route.app, f"{prefix}{route.path}")
        elif isinstance(route, APIWebSocketRoute):
            yield Route("WS", f"{prefix}{route.path}")
