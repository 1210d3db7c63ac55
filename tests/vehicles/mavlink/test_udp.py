import pytest

from vehicles.mavlink.udp import PEER_SILENT_S, EndpointError, Peers, Side, parse_endpoint

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
