"""What every bus promises, held against the local one and against real Zenoh sessions."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from itertools import groupby

import pytest

from tests.vehicles.buses import (
    KEYS,
    Reader,
    local_pair,
    peer_pair,
    reaches,
    routed_pair,
    until,
    zenoh_pair,
)
from vehicles.bus import Bus, BusError
from vehicles.inbox import SampleKind
from vehicles.keys import Topic
from vehicles.local_bus import LocalBus, LocalHub
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

pytestmark = pytest.mark.sockets

Pair = Callable[[], AbstractAsyncContextManager[tuple[Bus, Bus]]]
PAIRS = pytest.mark.parametrize("pair", [local_pair, zenoh_pair, peer_pair, routed_pair])


@PAIRS
@pytest.mark.asyncio
async def test_payloads_reach_who_listens_and_nobody_else(pair: Pair) -> None:
    async with pair() as (one, two):
        states, setpoints = Reader(), Reader()
        await one.subscribe(KEYS.robot(None, Topic.STATE), states.inbox)
        await one.subscribe(KEYS.robot(7, Topic.SETPOINT), setpoints.inbox)
        await reaches(two, states, KEYS.robot(7, Topic.STATE))
        two.publish(KEYS.robot(8, Topic.STATE), b"eight")
        two.publish(KEYS.robot(8, Topic.SETPOINT), b"not for seven")
        two.publish(KEYS.robot(7, Topic.SETPOINT), b"for seven")
        await until(lambda: setpoints.take())
        await until(lambda: any(s.payload == b"eight" for s in states.take()))
        assert {s.payload for s in setpoints.take()} == {b"for seven"}
        assert {s.key for s in states.take()} == {
            KEYS.robot(7, Topic.STATE),
            KEYS.robot(8, Topic.STATE),
        }


@PAIRS
@pytest.mark.asyncio
async def test_events_all_arrive_in_order(pair: Pair) -> None:
    async with pair() as (one, two):
        reader = Reader()
        key = KEYS.robot(7, Topic.EVENTS)
        await one.subscribe(KEYS.robot(None, Topic.EVENTS), reader.inbox)
        await reaches(two, reader, key)
        for number in range(500):
            two.publish(key, b"%d" % number)
        await until(lambda: reader.take()[-1].payload == b"499")
        numbers = [s.payload for s in reader.take() if s.payload != b"probe"]
        assert numbers == [b"%d" % number for number in range(500)]


@PAIRS
@pytest.mark.asyncio
async def test_a_closed_subscription_hears_nothing_more(pair: Pair) -> None:
    async with pair() as (one, two):
        closed, open_ = Reader(), Reader()
        key = KEYS.robot(7, Topic.STATE)
        subscription = await one.subscribe(key, closed.inbox)
        await one.subscribe(key, open_.inbox)
        await reaches(two, open_, key)
        # Nothing is under way any more when it is closed.
        two.publish(key, b"last")
        await until(lambda: open_.take()[-1].payload == b"last")
        await until(lambda: closed.take()[-1].payload == b"last")
        await subscription.close()
        await subscription.close()
        heard = len(closed.take())
        open_.samples.clear()
        await reaches(two, open_, key)
        assert len(closed.take()) == heard


@PAIRS
@pytest.mark.asyncio
async def test_tokens_appear_and_disappear(pair: Pair) -> None:
    async with pair() as (one, two):
        early, late = Reader(), Reader()
        await one.watch(KEYS.alive(None), early.inbox)
        token = await two.announce(KEYS.alive(7))
        await until(lambda: early.take())
        await one.watch(KEYS.alive(None), late.inbox)
        await until(lambda: late.take())
        assert late.take()[0].kind is SampleKind.PUT
        assert await one.present(KEYS.alive(None)) == (KEYS.alive(7),)
        assert await two.present(KEYS.alive(8)) == ()
        await token.close()
        await until(lambda: early.take()[-1].kind is SampleKind.DELETE)
        told = early.take()
        assert {sample.key for sample in told} == {KEYS.alive(7)}
        # Zenoh may say twice that somebody is there.
        kinds = [kind for kind, _ in groupby(sample.kind for sample in told)]
        assert kinds == [SampleKind.PUT, SampleKind.DELETE]
        await until(lambda: late.take()[-1].kind is SampleKind.DELETE)
        assert await one.present(KEYS.alive(None)) == ()


@pytest.mark.parametrize(
    "bus",
    [
        LocalBus(LocalHub()),
        ZenohBus(ZenohSettings(connect=("tcp/127.0.0.1:1",)), KEYS.delivery),
    ],
)
@pytest.mark.asyncio
async def test_a_bus_that_is_not_open_says_so(bus: Bus) -> None:
    reader = Reader()
    with pytest.raises(BusError, match="not open"):
        bus.publish("a", b"")
    with pytest.raises(BusError, match="not open"):
        await bus.subscribe("a", reader.inbox)
    with pytest.raises(BusError, match="not open"):
        await bus.watch("a", reader.inbox)
    with pytest.raises(BusError, match="not open"):
        await bus.announce("a")
    with pytest.raises(BusError, match="not open"):
        await bus.present("a")


@pytest.mark.asyncio
async def test_tokens_of_a_local_bus_end_with_it_and_are_shared_by_key() -> None:
    hub = LocalHub()
    reader = Reader()
    async with LocalBus(hub) as one:
        await one.watch(KEYS.alive(None), reader.inbox)
        async with LocalBus(hub) as two:
            await two.announce(KEYS.alive(7))
            async with LocalBus(hub) as three:
                await three.announce(KEYS.alive(7))
            assert [s.kind for s in reader.take()] == [SampleKind.PUT]
        assert [s.kind for s in reader.take()] == [SampleKind.PUT, SampleKind.DELETE]
