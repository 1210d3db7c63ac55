import asyncio
import json
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from server.live.channel import (
    MAX_LINE_BYTES,
    MAX_PENDING,
    Caller,
    ChannelClosed,
    Handler,
    ProtocolError,
    RequestRefused,
    RequestTimeout,
    Responder,
    encode,
)
from server.live.outbox import Frame
from tests.patience import PATIENCE_S


async def streams(
    sock: socket.socket, limit: int = MAX_LINE_BYTES
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection(sock=sock, limit=limit)


@asynccontextmanager
async def channel(
    handler: Handler, receive: Callable[[Frame], None] = lambda frame: None
) -> AsyncIterator[tuple[Caller, Responder]]:
    """A caller and a responder at the two ends of a socket pair."""
    near, far = socket.socketpair()
    near_reader, near_writer = await streams(near)
    far_reader, far_writer = await streams(far)
    caller = Caller(near_reader, near_writer, receive)
    responder = Responder(far_reader, far_writer, handler)

    async def serve() -> None:
        try:
            await responder.run()
        finally:
            far_writer.close()

    tasks = [asyncio.create_task(caller.run()), asyncio.create_task(serve())]
    try:
        yield caller, responder
    finally:
        near_writer.close()
        await asyncio.gather(*tasks)
        await near_writer.wait_closed()


async def echo(op: str, params: dict[str, Any]) -> dict[str, Any]:
    match op:
        case "echo":
            return params
        case "never":
            await asyncio.Event().wait()
        case "refuse":
            raise RequestRefused("too_many_comments", "enough", {"limit": 32})
        case "fail":
            raise KeyError("text")
        case "nan":
            return {"x": float("nan")}
    return {}


@pytest.mark.asyncio
async def test_answers_find_their_requests() -> None:
    async with channel(echo) as (caller, _):
        answers = await asyncio.gather(*(caller.request("echo", {"n": n}) for n in range(50)))
    assert answers == [{"n": n} for n in range(50)]


@pytest.mark.asyncio
async def test_any_text_survives() -> None:
    text = 'quotes " and \\ and \n newlines, ünïcödé \u2028 🚁'
    async with channel(echo) as (caller, _):
        assert await caller.request("echo", {"text": text}) == {"text": text}


@pytest.mark.asyncio
async def test_a_request_that_hangs_does_not_hold_up_the_next() -> None:
    async with channel(echo) as (caller, _):
        stuck = asyncio.create_task(caller.request("never", timeout_s=30.0))
        await asyncio.sleep(0)
        assert await caller.request("echo", {"hold": 1}) == {"hold": 1}
        stuck.cancel()


@pytest.mark.asyncio
async def test_no_answer_in_time_is_told() -> None:
    async with channel(echo) as (caller, _):
        with pytest.raises(RequestTimeout, match="no answer to never"):
            await caller.request("never", timeout_s=0.02)


@pytest.mark.asyncio
async def test_a_refusal_keeps_its_code_and_details() -> None:
    async with channel(echo) as (caller, _):
        with pytest.raises(RequestRefused) as refused:
            await caller.request("refuse")
    assert refused.value.code == "too_many_comments"
    assert refused.value.details == {"limit": 32}


@pytest.mark.asyncio
@pytest.mark.parametrize("op", ["fail", "nan"])
async def test_a_fault_in_one_request_is_its_askers_alone(op: str) -> None:
    async with channel(echo) as (caller, _):
        with pytest.raises(RequestRefused) as refused:
            await caller.request(op)
        assert refused.value.code == "internal_error"
        assert await caller.request("echo", {"hold": 1}) == {"hold": 1}


@pytest.mark.asyncio
async def test_the_end_of_the_other_side_fails_what_is_pending() -> None:
    near, far = socket.socketpair()
    caller = Caller(*await streams(near), lambda frame: None)
    running = asyncio.create_task(caller.run())
    request = asyncio.create_task(caller.request("echo"))
    await asyncio.sleep(0.01)
    far.close()
    with pytest.raises(ChannelClosed):
        await request
    await running
    with pytest.raises(ChannelClosed):
        await caller.request("echo")
    near.close()


@pytest.mark.asyncio
async def test_pushes_arrive_in_order_with_their_text() -> None:
    got = []
    done = asyncio.Event()

    def receive(frame: Frame) -> None:
        got.append(frame)
        if frame.data.get("seq") == 99:
            done.set()

    async with channel(echo, receive) as (_, responder):
        for seq in range(100):
            responder.push({"type": "event", "seq": seq})
        await done.wait()
    assert [frame.data["seq"] for frame in got] == list(range(100))
    assert all(json.loads(frame.text) == frame.data for frame in got)


@pytest.mark.asyncio
async def test_a_reader_that_sleeps_costs_the_pusher_nothing_but_old_snapshots() -> None:
    near, far = socket.socketpair()
    far_reader, far_writer = await streams(far)
    responder = Responder(far_reader, far_writer, echo)
    running = asyncio.create_task(responder.run())
    padding = "x" * 100_000
    for tick in range(500):  # 50 MB, far more than the socket takes
        responder.push({"type": "snapshot", "tick": tick, "padding": padding})
        await asyncio.sleep(0)
    got = []
    done = asyncio.Event()

    def receive(frame: Frame) -> None:
        got.append(frame.data["tick"])
        if frame.data["tick"] == 499:
            done.set()

    near_reader, near_writer = await streams(near)
    reading = asyncio.create_task(Caller(near_reader, near_writer, receive).run())
    await done.wait()
    near_writer.close()
    await running
    far_writer.close()
    await reading
    assert len(got) < 200
    assert got == sorted(got)


@pytest.mark.asyncio
@pytest.mark.parametrize("line", [b"no json\n", b"[1]\n", b'{"push": 3}\n', b"x" * 5000 + b"\n"])
async def test_what_is_no_message_ends_the_channel(line: bytes) -> None:
    near, far = socket.socketpair()
    reader, writer = await streams(near, limit=2000)
    caller = Caller(reader, writer, lambda frame: None)
    far.sendall(line)
    with pytest.raises(ProtocolError):
        await caller.run()
    writer.close()
    far.close()


def test_nan_is_never_sent() -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        encode({"x": float("nan")})


@pytest.mark.asyncio
async def test_there_is_always_room_for_hold() -> None:
    async def busy(op: str, params: dict[str, Any]) -> dict[str, Any]:
        if op != "hold":
            await asyncio.Event().wait()
        return {"state": "held"}

    async with channel(busy) as (caller, _):
        waiting = [
            asyncio.create_task(caller.request("override", timeout_s=PATIENCE_S))
            for _ in range(MAX_PENDING)
        ]
        await asyncio.sleep(0)
        with pytest.raises(RequestRefused, match="too many"):
            await caller.request("override")
        assert await caller.request("hold", timeout_s=PATIENCE_S) == {"state": "held"}
        for task in waiting:
            task.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)
