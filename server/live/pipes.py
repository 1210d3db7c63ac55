"""A child process's two pipes as a channel: served until the parent closes its end."""

import asyncio
import contextlib
import os
import sys
from collections.abc import Awaitable, Callable
from typing import Any

from server.live.channel import MAX_LINE_BYTES, Handler, Responder
from vehicles.lifeline import end_within
from vehicles.logs import configure_logs

Fly = Callable[[Responder], Awaitable[None]]


async def serve_pipes(handler: Handler, fly: Fly, given: Any, taken: Any) -> None:
    """Answer requests by `handler` and run `fly` beside, until the input ends."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(limit=MAX_LINE_BYTES)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), given)
    transport, protocol = await loop.connect_write_pipe(
        lambda: asyncio.streams.FlowControlMixin(), taken
    )
    writer = asyncio.StreamWriter(transport, protocol, None, loop)
    responder = Responder(reader, writer, handler)
    flight = asyncio.ensure_future(fly(responder))
    serving = asyncio.create_task(responder.run(), name="channel")
    try:
        await asyncio.wait({flight, serving}, return_when=asyncio.FIRST_COMPLETED)
        if flight.done():
            flight.result()
            await serving  # figures may still be asked for
        else:
            serving.result()
    finally:
        end_within()
        for task in (flight, serving):
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(flight, serving, return_exceptions=True)
        writer.close()


def own_output() -> Any:
    """Return standard output for ourselves alone: libraries print there, and go to the log."""
    configure_logs()
    channel = os.fdopen(os.dup(sys.stdout.fileno()), "wb", buffering=0)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return channel
