"""Serving live: what is started before the web side is imported, and what ends with it."""

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from server.api.catalogue import Definition
from server.cli.errors import UsageError
from server.cli.hosts import commands_of
from server.live.standby import standby
from server.settings import Settings
from vehicles.logs import configure_logs

if TYPE_CHECKING:
    from server.recording.reader import Recording


class Until(StrEnum):
    """When serving ends by itself."""

    STOPPED = "stopped"
    """Never: somebody ends it."""

    OVER = "over"
    """When the mission that was named is over."""


def serve_live(
    settings: Settings, definition: Definition | None, until: Until
) -> dict[str, Any] | None:
    """Serve until interrupted; fly the definition at once, if there is one.

    With Until.OVER serving ends with that mission. Returns the mission's figures, if there are
    any, also when it was interrupted.
    """
    configure_logs()
    try:
        with _listening(settings) as listener:
            return asyncio.run(_serve(settings, listener, definition, until))
    except KeyboardInterrupt:
        # Before the server listened, or while it was shutting down.
        return None


def serve_recording(settings: Settings, recording: "Recording") -> None:
    """Show a recording in the console until interrupted."""
    from server.api.archive import replay_definition

    serve_live(settings, replay_definition(recording), Until.STOPPED)


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
    settings: Settings, listener: socket.socket, definition: Definition | None, until: Until
) -> dict[str, Any] | None:
    async with standby(commands_of(definition)) as start:
        # The web side and the console take longest to import: planner and world do so meanwhile.
        from server.cli.site import serve

        return await serve(settings, start, listener, definition, until)
