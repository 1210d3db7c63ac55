import asyncio
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest

from llm.chat import ErrorKind
from llm.client import ChatClient, ModelProfile
from tests.llm.endpoints import ASKED, error_of, raw_server
from tests.patience import PATIENCE_S, busy

pytestmark = pytest.mark.sockets

HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: 1000\r\n\r\n"


@pytest.mark.parametrize("pieces", [(), (b"HTTP/1.1 200",), (HEAD,), (HEAD, b'{"choices": [')])
@pytest.mark.asyncio
async def test_a_stalling_socket_meets_the_total_time_out(pieces: tuple[bytes, ...]) -> None:
    async with raw_server(*pieces) as server, server.client() as client:
        error = await error_of(client, timeout_s=0.2)
        assert error.kind is ErrorKind.TIMEOUT
        assert "no answer within 0.2 s" in str(error), "not the read time-out, of half a minute"
        await asyncio.wait_for(server.gone.wait(), PATIENCE_S)


@pytest.mark.asyncio
async def test_silence_meets_the_read_time_out() -> None:
    async with raw_server(HEAD) as server, server.client(read_timeout_s=0.1) as client:
        error = await error_of(client, timeout_s=PATIENCE_S)
    assert error.kind is ErrorKind.TIMEOUT
    assert "silent" in str(error)


@pytest.mark.asyncio
async def test_an_address_that_never_accepts_meets_the_connect_time_out() -> None:
    with full_backlog() as url:
        profile = ModelProfile(url, "m", connect_timeout_s=0.2, attempts=1)
        async with ChatClient(profile) as client:
            error = await error_of(client, timeout_s=PATIENCE_S)
    assert error.kind is ErrorKind.CONNECTION
    assert "ConnectTimeout" in str(error)


@contextmanager
def full_backlog() -> Iterator[str]:
    """Listen without ever accepting, with no room left for another connection."""
    with ExitStack() as stack:
        listener = stack.enter_context(socket.socket())
        listener.bind(("127.0.0.1", 0))
        listener.listen(0)
        for _ in range(4):
            waiting = stack.enter_context(socket.socket())
            waiting.setblocking(False)
            waiting.connect_ex(listener.getsockname())
        yield f"http://127.0.0.1:{listener.getsockname()[1]}/v1"


@pytest.mark.asyncio
async def test_a_call_is_cancelled_within_a_tenth_of_a_second() -> None:
    # The best of five: a busy machine may hold up any single one.
    assert min([await cancellation_s() for _ in range(5)]) < 0.1 * busy()


async def cancellation_s() -> float:
    async with raw_server(HEAD, b"{") as server, server.client() as client:
        call = asyncio.create_task(client.complete(ASKED, 30.0))
        await asyncio.wait_for(server.asked.wait(), PATIENCE_S)
        started = time.perf_counter()
        call.cancel()
        with pytest.raises(asyncio.CancelledError):
            await call
        taken_s = time.perf_counter() - started
        await asyncio.wait_for(server.gone.wait(), PATIENCE_S)
    return taken_s


@pytest.mark.asyncio
async def test_nobody_there_is_a_connection_error() -> None:
    server = await asyncio.start_server(lambda _r, _w: None, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    server.close()
    await server.wait_closed()
    profile = ModelProfile(f"http://127.0.0.1:{port}/v1", "m", backoff_s=0.001)
    async with ChatClient(profile) as client:
        error = await error_of(client)
    assert error.kind is ErrorKind.CONNECTION
    assert client.usage.requests == 3


@pytest.mark.asyncio
async def test_garbage_on_the_socket_is_a_connection_error() -> None:
    nonsense = b"\x00\x01 nonsense\r\n\r\n"
    async with raw_server(nonsense) as server, server.client(attempts=1) as client:
        assert (await error_of(client)).kind is ErrorKind.CONNECTION
