"""Pairs of buses that reach each other, and waiting without guessing how long."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from tests.patience import PATIENCE_S
from vehicles.bus import Bus
from vehicles.inbox import Inbox, Sample
from vehicles.keys import TeamKeys
from vehicles.local_bus import LocalBus, LocalHub
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

KEYS = TeamKeys("red")
LOOPBACK = "tcp/127.0.0.1:0"


@asynccontextmanager
async def local_pair() -> AsyncIterator[tuple[Bus, Bus]]:
    """Open two parties of one hub."""
    hub = LocalHub()
    async with LocalBus(hub) as one, LocalBus(hub) as two:
        yield one, two


@asynccontextmanager
async def zenoh_pair() -> AsyncIterator[tuple[Bus, Bus]]:
    """Open a router and a client over a loopback socket."""
    router = ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,))
    async with ZenohBus(router, KEYS.delivery) as one:
        client = ZenohSettings(connect=one.endpoints)
        async with ZenohBus(client, KEYS.delivery) as two:
            yield one, two


@asynccontextmanager
async def peer_pair() -> AsyncIterator[tuple[Bus, Bus]]:
    """Open two peers, one of which names the other."""
    listener = ZenohSettings(mode=ZenohMode.PEER, listen=(LOOPBACK,))
    async with ZenohBus(listener, KEYS.delivery) as one:
        caller = ZenohSettings(mode=ZenohMode.PEER, connect=one.endpoints)
        async with ZenohBus(caller, KEYS.delivery) as two:
            yield one, two


@asynccontextmanager
async def routed_pair() -> AsyncIterator[tuple[Bus, Bus]]:
    """Open two clients of one router."""
    router = ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,))
    async with ZenohBus(router, KEYS.delivery) as between:
        client = ZenohSettings(connect=between.endpoints)
        async with ZenohBus(client, KEYS.delivery) as one, ZenohBus(client, KEYS.delivery) as two:
            yield one, two


class Reader:
    """An inbox with everything that ever waited in it."""

    def __init__(self) -> None:
        self.inbox = Inbox(KEYS.delivery)
        self.samples: list[Sample] = []

    def take(self) -> list[Sample]:
        """Return everything so far."""
        self.samples.extend(self.inbox.drain())
        return self.samples


async def until(condition: Callable[[], object], limit_s: float = PATIENCE_S) -> None:
    """Wait for a condition; fail after a limit."""
    async with asyncio.timeout(limit_s):
        # What is waited for happens on Zenoh's threads; there is no event to wait for.
        while not condition():  # noqa: ASYNC110
            await asyncio.sleep(0.005)


async def reaches(sender: Bus, reader: Reader, key: str) -> None:
    """Wait until what is published on a key arrives (a subscription takes time to spread)."""

    def sent_and_seen() -> bool:
        sender.publish(key, b"probe")
        return any(sample.key == key for sample in reader.take())

    await until(sent_and_seen)
