import asyncio
from typing import Any

import pytest

from server.live.channel import frame
from server.live.fanout import TOO_SLOW, Fanout, Messages
from server.live.outbox import Frame, Outbox, OutboxClosed


def snapshot(tick: int) -> Frame:
    return frame({"type": "snapshot", "tick": tick})


def event(seq: int) -> Frame:
    return frame({"type": "event", "seq": seq})


async def drained(outbox: Outbox) -> list[dict[str, Any]]:
    outbox.close("test over")
    return [said async for said in Messages(outbox)]


@pytest.mark.asyncio
async def test_the_newest_snapshot_wins() -> None:
    outbox = Outbox()
    for tick in range(5):
        assert outbox.put(snapshot(tick))
    assert outbox.replaced == 4
    assert await drained(outbox) == [{"type": "snapshot", "tick": 4}]


@pytest.mark.asyncio
async def test_events_are_kept_in_order_before_the_snapshot() -> None:
    outbox = Outbox()
    for said in (event(1), snapshot(1), event(2), snapshot(2), event(3)):
        outbox.put(said)
    assert [m.get("seq", "snapshot") for m in await drained(outbox)] == [1, 2, 3, "snapshot"]


@pytest.mark.asyncio
async def test_what_was_kept_is_told_before_the_snapshot_that_shows_it() -> None:
    """Also to a reader who is behind: a client must not see what a crash would take back."""
    outbox = Outbox()
    for said in (snapshot(1), frame({"type": "checkpoint", "tick": 2}), snapshot(2)):
        outbox.put(said)
    assert [m["type"] for m in await drained(outbox)] == ["checkpoint", "snapshot"]


@pytest.mark.asyncio
async def test_an_event_beyond_the_bound_finds_no_room() -> None:
    outbox = Outbox(max_events=2)
    assert [outbox.put(event(seq)) for seq in range(3)] == [True, True, False]
    assert outbox.put(snapshot(1))


@pytest.mark.asyncio
async def test_a_waiting_reader_is_woken() -> None:
    outbox = Outbox()
    reader = asyncio.create_task(outbox.get())
    await asyncio.sleep(0)
    outbox.put(event(7))
    assert (await reader).data["seq"] == 7


@pytest.mark.asyncio
async def test_a_closed_outbox_says_why_and_takes_no_more() -> None:
    outbox = Outbox()
    outbox.close("enough")
    assert not outbox.put(event(1))
    with pytest.raises(OutboxClosed, match="enough"):
        await outbox.get()


@pytest.mark.asyncio
async def test_a_late_comer_gets_the_last_snapshot_at_once() -> None:
    fanout = Fanout()
    fanout.publish(event(1))
    fanout.publish(snapshot(3))
    with fanout.subscribe() as outbox:
        assert (await outbox.get()).data["tick"] == 3


@pytest.mark.asyncio
async def test_every_reader_gets_the_very_same_text() -> None:
    fanout = Fanout()
    with fanout.subscribe() as one, fanout.subscribe() as other:
        fanout.publish(snapshot(1))
        assert (await one.get()).text is (await other.get()).text


@pytest.mark.asyncio
async def test_a_slow_reader_is_dropped_and_the_others_miss_nothing() -> None:
    fanout = Fanout(max_events=3)
    with fanout.subscribe() as slow, fanout.subscribe() as quick:
        read = []
        for seq in range(10):
            fanout.publish(event(seq))
            read.append((await quick.get()).data["seq"])
        assert read == list(range(10))
        assert fanout.readers == 1
        assert fanout.dropped == 1
        assert [(await slow.get()).data["seq"] for _ in range(3)] == [0, 1, 2]
        with pytest.raises(OutboxClosed) as closed:
            await slow.get()
        assert closed.value.reason == TOO_SLOW


@pytest.mark.asyncio
async def test_leaving_ends_the_subscription() -> None:
    fanout = Fanout()
    with fanout.subscribe():
        assert fanout.readers == 1
    assert fanout.readers == 0


@pytest.mark.asyncio
async def test_a_cancelled_read_loses_nothing() -> None:
    outbox = Outbox()
    read = Messages(outbox)
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.01):
            await anext(read)
    outbox.put(event(1))
    assert (await anext(read))["seq"] == 1
