"""The test run itself cannot reach beyond this machine, but can use all of loopback."""

import asyncio
import socket

import httpx
import pytest

from tests.network import NetworkBlockedError, is_local

DOCUMENTATION_ADDRESS = "192.0.2.1"  # reserved for examples, never routed


def test_a_connection_beyond_this_machine_is_refused() -> None:
    with socket.socket() as probe, pytest.raises(NetworkBlockedError):
        probe.connect((DOCUMENTATION_ADDRESS, 9))


def test_a_datagram_beyond_this_machine_is_refused() -> None:
    with (
        socket.socket(type=socket.SOCK_DGRAM) as probe,
        pytest.raises(NetworkBlockedError),
    ):
        probe.sendto(b"hello", (DOCUMENTATION_ADDRESS, 9))


def test_a_name_beyond_this_machine_is_not_looked_up() -> None:
    with pytest.raises(NetworkBlockedError):
        socket.getaddrinfo("falconer.invalid", 80)


def test_an_http_client_is_refused_too() -> None:
    with pytest.raises(NetworkBlockedError):
        httpx.get(f"http://{DOCUMENTATION_ADDRESS}/", timeout=1.0)


async def _echo_over_loopback() -> bytes:
    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(await reader.readline())
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(answer, "127.0.0.1", 0)
    async with server:
        port = server.sockets[0].getsockname()[1]
        reader, writer = await asyncio.open_connection("localhost", port, family=socket.AF_INET)
        writer.write(b"hello\n")
        line = await reader.readline()
        writer.close()
        await writer.wait_closed()
        return line


def test_loopback_stays_open() -> None:
    assert asyncio.run(_echo_over_loopback()) == b"hello\n"


@pytest.mark.parametrize(
    "host", [None, "", "localhost", b"localhost", "127.0.0.1", "::1", "0.0.0.0"]
)
def test_local_hosts(host: object) -> None:
    assert is_local(host)


@pytest.mark.parametrize("host", ["10.0.0.1", "fe80::1%eth0", "example.org", "2001:db8::1"])
def test_remote_hosts(host: object) -> None:
    assert not is_local(host)
