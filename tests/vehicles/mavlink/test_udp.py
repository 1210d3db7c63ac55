import asyncio
import socket
from typing import Any

import pytest

from vehicles.mavlink.udp import (
    PEER_SILENT_S,
    EndpointError,
    Peers,
    Side,
    open_udp,
    parse_endpoint,
    peer_of,
)

pytestmark = pytest.mark.sockets

A, B, C = ("10.0.0.1", 1), ("10.0.0.2", 2), ("10.0.0.3", 3)


@pytest.mark.parametrize(
    ("text", "side", "host", "port"),
    [
        ("udpin:127.0.0.1:14550", Side.IN, "127.0.0.1", 14550),
        ("udp:0.0.0.0:14540", Side.IN, "0.0.0.0", 14540),
        ("udpout:drone-7.local:14555", Side.OUT, "drone-7.local", 14555),
        ("udpin:[::1]:14550", Side.IN, "::1", 14550),
    ],
)
def test_endpoints(text: str, side: Side, host: str, port: int) -> None:
    endpoint = parse_endpoint(text)
    assert (endpoint.side, endpoint.host, endpoint.port) == (side, host, port)
    assert parse_endpoint(str(endpoint)) == endpoint


@pytest.mark.parametrize(
    "text",
    ["", "14550", "tcp:127.0.0.1:1", "udpin:127.0.0.1", "udpin:127.0.0.1:99999", "udpout:h:0"],
)
def test_what_is_no_endpoint(text: str) -> None:
    with pytest.raises(EndpointError):
        parse_endpoint(text)


def test_a_fixed_peer_is_the_only_one() -> None:
    peers = Peers(A, most=1)
    assert peers.addresses() == (A,)
    assert peers.admits(A, 0.0)
    assert not peers.admits(B, 0.0)


def test_a_peer_is_replaced_only_when_it_is_silent() -> None:
    peers = Peers(None, most=1)
    assert peers.addresses() == ()
    assert peers.admits(A, 0.0)
    peers.hear(A, 0.0)
    assert not peers.admits(B, PEER_SILENT_S)
    assert peers.admits(B, PEER_SILENT_S + 0.1)
    peers.hear(B, PEER_SILENT_S + 0.1)
    assert peers.addresses() == (B,)


def test_several_peers_are_kept() -> None:
    peers = Peers(None, most=2)
    peers.hear(A, 0.0)
    peers.hear(B, 1.0)
    assert not peers.admits(C, 1.0)
    peers.hear(A, 2.0)
    assert peers.admits(C, 5.5)
    peers.hear(C, 5.5)
    assert peers.addresses() == (A, C)


V6 = (socket.AF_INET6, socket.SOCK_DGRAM, 17, "", ("2001:db8::7", 14550, 0, 0))
V4 = (socket.AF_INET, socket.SOCK_DGRAM, 17, "", ("192.0.2.7", 14550))


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("addresses", "peer", "own"),
    [
        ([V6, V4], ("192.0.2.7", 14550), "0.0.0.0"),
        ([V6], ("2001:db8::7", 14550), "::"),
    ],
)
async def test_a_name_is_spoken_to_by_a_socket_of_its_kind_of_address(
    monkeypatch: pytest.MonkeyPatch, addresses: list[Any], peer: tuple[str, int], own: str
) -> None:
    loop, bound = asyncio.get_running_loop(), []

    async def resolved(*_: Any, **__: Any) -> list[Any]:
        return addresses

    async def noted(*_: Any, local_addr: tuple[str, int]) -> Any:
        bound.append(local_addr)
        raise OSError("only looked at")

    monkeypatch.setattr(loop, "getaddrinfo", resolved)
    monkeypatch.setattr(loop, "create_datagram_endpoint", noted)
    endpoint = parse_endpoint("udpout:drone-7.local:14550")
    assert await peer_of(endpoint) == peer
    with pytest.raises(EndpointError, match="only looked at"):
        await open_udp(endpoint, peer, lambda datagram, address: None)
    assert bound == [(own, 0)]
