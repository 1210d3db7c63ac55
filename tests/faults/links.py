"""Links that can be cut, thinned out, listened to and spoken into, in the test's own process."""

import asyncio
import math
import random
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

from tests.patience import PATIENCE_S
from vehicles.mavlink.protocol import mavlink
from vehicles.mavlink.udp import Address, Endpoint, Side, UdpSocket, open_udp

POSITION, SETPOINT = 32, 84
"""Numbers of LOCAL_POSITION_NED and SET_POSITION_TARGET_LOCAL_NED."""


@dataclass
class Heard:
    """What went over a MAVLink link lately."""

    speed_m_s: float = 0.0
    """The autopilot's own, in the plane."""

    place: tuple[float, float] = (0.0, 0.0)
    """North and east of the autopilot's origin."""

    setpoints: list[tuple[float, float]] = field(default_factory=list)
    """When each setpoint was sent and how fast it was to be flown."""


class MavlinkLink:
    """A UDP proxy between a bridge and its autopilot. `async with`.

    Args:
        autopilot: Port of the autopilot.
        seed: Of the dice that lose datagrams.
    """

    def __init__(self, autopilot: int, seed: int = 0) -> None:
        self.loss = 0.0
        """Share of datagrams lost, either way."""

        self.heard = Heard()
        self._autopilot: Address = ("127.0.0.1", autopilot)
        self._dice = random.Random(seed)
        self._reader = mavlink.MAVLink(None)
        self._reader.robust_parsing = True
        self._bridge: Address | None = None
        self._offset_s = math.inf
        """Between our clock and that of the bridge, which counts from its start; the quickest way
        so far is taken for none."""

    async def __aenter__(self) -> "MavlinkLink":
        here = Endpoint(Side.IN, "127.0.0.1", 0)
        self._front: UdpSocket = await open_udp(here, None, self._from_bridge)
        self._back: UdpSocket = await open_udp(here, None, self._from_autopilot)
        self.port = self._front.port
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self._front.close()
        await self._back.close()

    def to_bridge(self, datagram: bytes) -> None:
        """Say something to the bridge in the autopilot's place."""
        if self._bridge is not None:
            self._front.send(datagram, self._bridge)

    def to_autopilot(self, message: Any, system: int = 255) -> None:
        """Say something to the autopilot, as a pilot's ground station would."""
        sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        self._back.send(message.pack(sender), self._autopilot)

    def change_mode(self, system: int, parameters: tuple[float, float]) -> None:
        """Let a pilot change the autopilot's mode."""
        command = mavlink.MAV_CMD_DO_SET_MODE
        self.to_autopilot(
            mavlink.MAVLink_command_long_message(system, 1, command, 0, 1, *parameters, 0, 0, 0, 0)
        )

    def since(self, at_s: float) -> list[tuple[float, float]]:
        """Return the setpoints that were sent after a moment, however late they passed."""
        return [one for one in self.heard.setpoints if one[0] > at_s]

    def _from_bridge(self, datagram: bytes, address: Address) -> None:
        if address != self._bridge:
            self._bridge, self._offset_s = address, math.inf
        self._listen(datagram)
        if self._dice.random() >= self.loss:
            self._back.send(datagram, self._autopilot)

    def _from_autopilot(self, datagram: bytes, address: Address) -> None:
        self._listen(datagram)
        if self._bridge is not None and self._dice.random() >= self.loss:
            self._front.send(datagram, self._bridge)

    def _listen(self, datagram: bytes) -> None:
        number = int.from_bytes(datagram[7:10], "little")
        if number not in (POSITION, SETPOINT):
            return
        for message in self._reader.parse_buffer(datagram) or ():
            if message.get_type() == "LOCAL_POSITION_NED":
                self.heard.speed_m_s = math.hypot(message.vx, message.vy)
                self.heard.place = (message.x, message.y)
            elif message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                speed_m_s = math.hypot(message.vx, message.vy)
                boot_s = 1e-3 * message.time_boot_ms
                self._offset_s = min(self._offset_s, monotonic() - boot_s)
                self.heard.setpoints.append((boot_s + self._offset_s, speed_m_s))
                del self.heard.setpoints[:-2000]


class BusLink:
    """A TCP proxy on the way to the bus or a server, which can be cut and healed. `async with`.

    Args:
        port: Where that one listens.
    """

    def __init__(self, port: int) -> None:
        self.forge: Callable[[bytes], bytes] = bytes
        """What becomes of the bytes that come back."""

        self._to = port
        self._connections: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> "BusLink":
        self.port = 0
        await self.heal()
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.cut()

    async def heal(self) -> None:
        """Take connections, again after a cut."""
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", self.port)

    @property
    def used(self) -> bool:
        """Whether somebody is connected through it."""
        return bool(self._connections)

    async def cut(self) -> None:
        """Break every connection and take no other."""
        self._server.close()
        for writer in self._connections:
            writer.transport.abort()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.create_task(self._serve(reader, writer))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        pair = {writer}
        try:
            far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._to)
            pair.add(far_writer)
            self._connections |= pair
            async with asyncio.TaskGroup() as group:
                group.create_task(_copy(reader, far_writer, bytes))
                group.create_task(_copy(far_reader, writer, lambda data: self.forge(data)))
        except OSError:
            return  # nobody listens: whoever connected is cut off
        finally:
            self._connections -= pair
            for one in pair:
                one.transport.abort()


async def _copy(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, forge: Callable[[bytes], bytes]
) -> None:
    """Carry bytes one way until that way ends."""
    with suppress(OSError):  # the other side was cut: so is this one
        while data := await reader.read(1 << 16):
            writer.write(forge(data))
            await writer.drain()
    writer.transport.abort()


async def until(
    condition: Callable[[], object], patience_s: float = PATIENCE_S, what: str = "it"
) -> float:
    """Wait for a condition; return how long it took. Raises AssertionError with its name."""
    began_s = monotonic()
    while not condition():
        if monotonic() - began_s > patience_s:
            raise AssertionError(f"{what}: not within {patience_s:g} s")
        await asyncio.sleep(0.01)
    return monotonic() - began_s
