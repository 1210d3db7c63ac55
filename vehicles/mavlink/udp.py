"""UDP for asyncio: addresses as MAVLink tools write them, and an endpoint that never blocks."""

import asyncio
import re
import socket
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

Address: TypeAlias = tuple[str, int]

PEER_SILENT_S = 3.0
"""A peer silent for so long may be replaced by one that speaks from elsewhere."""

_ENDPOINT = re.compile(r"(udp|udpin|udpout):(\[[0-9a-fA-F:.]+\]|[^:\[\]/]+):(\d{1,5})")


class EndpointError(ValueError):
    """Raised when an endpoint cannot be understood or opened."""


class Side(StrEnum):
    """Who speaks first."""

    IN = "udpin"
    """We listen; the peer finds us."""

    OUT = "udpout"
    """We speak to an address; the peer listens."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One end of a link, `udpin:HOST:PORT` or `udpout:HOST:PORT` (`udp:` is `udpin:`)."""

    side: Side
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.side.value}:{host}:{self.port}"


def parse_endpoint(text: str) -> Endpoint:
    """Return the endpoint a text names.

    Raises:
        EndpointError: It names none.
    """
    found = _ENDPOINT.fullmatch(text)
    if found is None or int(found[3]) > 65535:
        raise EndpointError(f"{text!r} is no endpoint: write udpin:HOST:PORT or udpout:HOST:PORT")
    side = Side.OUT if found[1] == "udpout" else Side.IN
    if side is Side.OUT and int(found[3]) == 0:
        raise EndpointError(f"{text!r}: a port to speak to is needed")
    return Endpoint(side, found[2].strip("[]"), int(found[3]))


class Peers:
    """Whom to answer: those heard lately, or the one that was fixed beforehand.

    Args:
        fixed: The only peer there ever is, None to learn them.
        most: How many are kept; the vehicle's side of a link has one.
    """

    def __init__(self, fixed: Address | None, most: int) -> None:
        self._fixed = fixed
        self._most = most
        self._heard: dict[Address, float] = {}

    def admits(self, address: Address, now_s: float) -> bool:
        """Tell whether what comes from an address may be listened to."""
        if self._fixed is not None:
            return address == self._fixed
        if address in self._heard or len(self._heard) < self._most:
            return True
        return now_s - min(self._heard.values()) > PEER_SILENT_S

    def hear(self, address: Address, now_s: float) -> None:
        """Take note of an admitted peer that has proved who it is."""
        if address not in self._heard and len(self._heard) >= self._most:
            del self._heard[min(self._heard, key=self._heard.__getitem__)]
        self._heard[address] = now_s

    def addresses(self) -> tuple[Address, ...]:
        """Return whom to send to."""
        return tuple(self._heard) if self._fixed is None else (self._fixed,)


class UdpSocket(asyncio.DatagramProtocol):
    """A datagram socket on the running loop; opened by `open_udp`.

    Args:
        receive: Called with every datagram and where it came from; must not raise.
    """

    def __init__(self, receive: Callable[[bytes, Address], None]) -> None:
        self.errors = 0
        self.dropped = 0
        self._receive = receive
        self._full = False
        self._transport: asyncio.DatagramTransport | None = None
        self._closed = asyncio.get_running_loop().create_future()

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        """Keep the transport."""
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Hand a datagram on."""
        self._receive(data, (addr[0], addr[1]))

    def pause_writing(self) -> None:
        """Take note that the socket's buffer is full."""
        self._full = True

    def resume_writing(self) -> None:
        """Take note that there is room again."""
        self._full = False

    def error_received(self, exc: Exception) -> None:
        """Count what the network complains of: nobody listens there, no route."""
        self.errors += 1

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell whoever waits for the end."""
        if not self._closed.done():
            self._closed.set_result(exc)

    @property
    def port(self) -> int:
        """The local port."""
        assert self._transport is not None
        return int(self._transport.get_extra_info("sockname")[1])

    def send(self, datagram: bytes, address: Address) -> None:
        """Send a datagram; one that finds the socket's buffer full is dropped and counted."""
        if self._transport is None or self._transport.is_closing():
            return
        if self._full:
            self.dropped += 1
            return
        self._transport.sendto(datagram, address)

    async def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()
            await self._closed


async def open_udp(
    endpoint: Endpoint, peer: Address | None, receive: Callable[[bytes, Address], None]
) -> UdpSocket:
    """Open an endpoint on the running loop.

    Args:
        endpoint: Ours.
        peer: The fixed peer, as `peer_of` found it: the socket speaks its kind of address.
        receive: Called with every datagram and where it came from; must not raise.

    Raises:
        EndpointError: The address cannot be had.
    """
    bound = (endpoint.host, endpoint.port)
    if peer is not None:
        bound = ("::" if ":" in peer[0] else "0.0.0.0", 0)
    try:
        _, opened = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: UdpSocket(receive), local_addr=bound
        )
    except OSError as error:
        raise EndpointError(f"cannot open {endpoint}: {error.strerror or error}") from error
    return opened


async def peer_of(endpoint: Endpoint) -> Address | None:
    """Return the fixed peer of an endpoint, None where peers are to be learned.

    Of a name that has addresses of both kinds the IPv4 one counts: that is where autopilots and
    their tools listen.

    Raises:
        EndpointError: Its name is not known.
    """
    if endpoint.side is Side.IN:
        return None
    try:
        found = await asyncio.get_running_loop().getaddrinfo(endpoint.host, endpoint.port)
    except OSError as error:
        raise EndpointError(f"{endpoint}: {error.strerror or error}") from error
    addresses = sorted(found, key=lambda one: one[0] is not socket.AF_INET)
    host, port = addresses[0][4][:2]
    return (str(host), int(port))
