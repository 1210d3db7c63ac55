"""Serving live: the web application, and a mission of its own where one is named."""

import asyncio
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer
import uvicorn

from server.api.app import create_app, installed_console
from server.api.catalogue import Definition
from server.api.errors import ServiceError
from server.api.library import ScenarioLibrary
from server.api.service import MissionService
from server.api.web import web_config
from server.cli.errors import UsageError
from server.encoding import MissionState
from server.live.host import ProcessHost
from server.live.world import WorldHost
from server.logs import configure_logs
from server.settings import Settings

AUTHOR = "command line"
LOOK_S = 0.2


def serve_live(
    settings: Settings, definition: Definition | None, *, until_over: bool
) -> dict[str, Any] | None:
    """Serve until interrupted; fly the definition at once, if there is one.

    With `until_over` serving ends with that mission. Returns its figures, if there are any.
    """
    configure_logs()
    try:
        with _listening(settings) as listener:
            return asyncio.run(_serve(settings, listener, definition, until_over=until_over))
    except KeyboardInterrupt:
        # The server has shut down in order before it passes the signal on.
        return None


@contextmanager
def _listening(settings: Settings) -> Iterator[socket.socket]:
    """Take the address before anything is started. Raises UsageError when it is not to be had."""
    try:
        family = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM)[0][0]
        listener = socket.create_server((settings.host, settings.port), family=family)
    except OSError as error:
        raise UsageError(
            f"cannot listen on {settings.host}:{settings.port}: {error.strerror}; "
            "another port is chosen by --port"
        ) from error
    with listener:
        yield listener


async def _serve(
    settings: Settings,
    listener: socket.socket,
    definition: Definition | None,
    *,
    until_over: bool,
) -> dict[str, Any] | None:
    service = MissionService(
        ScenarioLibrary(settings), lambda _: ProcessHost(), lambda _: WorldHost()
    )
    app = create_app(settings, service, installed_console())
    server = uvicorn.Server(web_config(app, settings))
    result: dict[str, Any] | None = None
    refusal: ServiceError | None = None
    async with asyncio.TaskGroup() as group:
        serving = group.create_task(server.serve(sockets=[listener]), name="web server")
        if await _started(server, serving):
            _say(f"Falconer on {_address(listener)} (Ctrl-C ends it)")
            if definition is not None:
                try:
                    result = await _fly(service, definition, serving)
                except ServiceError as error:
                    refusal = error
                server.should_exit |= until_over or refusal is not None
    if refusal is not None:
        raise UsageError(str(refusal)) from refusal
    return result


async def _started(server: uvicorn.Server, serving: asyncio.Task[None]) -> bool:
    """Wait until the server listens; return False when it has ended instead.

    The server offers a flag and no event, so it is looked at.
    """
    while not server.started:
        done, _ = await asyncio.wait({serving}, timeout=0.02)
        if done:
            return False
    return True


async def _fly(
    service: MissionService, definition: Definition, serving: asyncio.Task[None]
) -> dict[str, Any] | None:
    """Start the mission, wait until it is over or the server ends, return its figures.

    Raises ServiceError when it cannot be started.
    """
    mission_id = service.add(definition).id
    _say(f"starting {definition.scenario} ...")
    await service.start(mission_id, AUTHOR)
    over = {MissionState.ENDED, MissionState.FAILED}
    while service.mission(mission_id).state not in over:
        done, _ = await asyncio.wait({serving}, timeout=LOOK_S)
        if done:
            return None
    try:
        return await service.result(mission_id)
    except ServiceError as error:
        _say(f"no figures: {error}")
        return None


def _address(listener: socket.socket) -> str:
    host, port = listener.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _say(words: str) -> None:
    typer.echo(words, file=sys.stderr)
