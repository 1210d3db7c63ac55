"""The link where no namespaces can be had: a TCP forwarder between two loopback addresses.

A stream loses nothing, so a loss is what a stream makes of it: all that comes after waits. While
the link is cut, what was sent waits as in the kernel's buffers, and new connections lead nowhere.
"""

import asyncio
from contextlib import suppress
from typing import Self

from benchmarks.field.ways import StreamWay, Weather

_PIECE = 1 << 14
_WAITING = 256
"""Pieces on their way at most; then the sender is no longer read."""


class Forwarder:
    """Listens on a port and passes on to another. `async with`.

    Args:
        weather: How the link is; may change at any time.
        to: Host and port to pass on to.
        seed: Of the dice.
    """

    def __init__(self, weather: Weather, to: tuple[str, int], seed: int) -> None:
        self._weather, self._to = weather, to
        self.ways = (StreamWay(weather, seed), StreamWay(weather, seed + 1))
        """From the side that was connected to, and back to it."""

        self._serving: set[asyncio.Task[None]] = set()
        self.port = 0

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *exception: object) -> None:
        self._server.close()
        for task in self._serving:
            task.cancel()
        await asyncio.gather(*self._serving, return_exceptions=True)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.create_task(self._serve(reader, writer))
        self._serving.add(task)
        task.add_done_callback(self._serving.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        ends = [writer]
        try:
            await self._weather.opened.wait()
            other_reader, other_writer = await asyncio.open_connection(*self._to)
            ends.append(other_writer)
            async with asyncio.TaskGroup() as both:
                both.create_task(self._carry(reader, other_writer, self.ways[1]))
                both.create_task(self._carry(other_reader, writer, self.ways[0]))
        except* OSError:
            pass  # one end is gone: so is the other
        finally:
            for end in ends:
                end.transport.abort()

    async def _carry(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, way: StreamWay
    ) -> None:
        """Carry a stream one way until it ends."""
        under_way: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(_WAITING)
        clock = asyncio.get_running_loop().time

        async def take() -> None:
            while piece := await reader.read(_PIECE):
                await under_way.put((way.due_s(clock()), piece))
            await under_way.put((clock(), b""))

        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(take())
            while True:
                due_s, piece = await under_way.get()
                await asyncio.sleep(max(0.0, due_s - clock()))
                await self._weather.opened.wait()
                if not piece:
                    raise ConnectionResetError
                writer.write(piece)
                with suppress(ConnectionResetError):
                    await writer.drain()
