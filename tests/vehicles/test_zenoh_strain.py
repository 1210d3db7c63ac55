"""The bus under strain, over real sockets: a peer that hangs, and one that floods."""

import asyncio
import os
import signal
import sys
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from pathlib import Path
from time import perf_counter

import pytest

from tests.vehicles.buses import KEYS, LOOPBACK, until
from vehicles.inbox import Inbox, Sample
from vehicles.keys import Topic
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

ROOT = Path(__file__).resolve().parents[2]
ROUTER = ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,))

LISTENS = """
import asyncio, sys
from vehicles.inbox import Inbox
from vehicles.keys import TeamKeys
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

async def main():
    keys = TeamKeys("red")
    async with ZenohBus(ZenohSettings(connect=(sys.argv[1],)), keys.delivery) as bus:
        await bus.subscribe("falconer/red/**", Inbox(keys.delivery))
        await bus.announce(keys.alive(7))
        await asyncio.sleep(600.0)

asyncio.run(main())
"""

FLOODS = """
import sys
import zenoh
from vehicles.zenoh_settings import ZenohSettings, configuration

with zenoh.open(configuration(ZenohSettings(connect=(sys.argv[1],)), 5000)) as session:
    for number in range(int(sys.argv[2])):
        topic = ("state", "events", "nonsense")[number % 3]
        key = f"falconer/red/robots/{number % 30}/{topic}"
        session.put(key, b"%d" % number + 500 * b".",
                    congestion_control=zenoh.CongestionControl.BLOCK)
    session.put("falconer/red/robots/7/health", b"done",
                congestion_control=zenoh.CongestionControl.BLOCK)
    sys.stdin.read()
"""


class Flooded:
    """Passes on to an inbox, and tells when the flood's last message has come through.

    Each subscriber is called from a thread of its own, so that only this one can tell.
    """

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self.over = False

    def attach(self) -> None:
        self._inbox.attach()

    def offer(self, sample: Sample) -> None:
        self._inbox.offer(sample)
        self.over = self.over or sample.payload == b"done"


@asynccontextmanager
async def process(text: str, *arguments: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run a program beside the test; see to it that it is gone afterwards."""
    started = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", text, *arguments),
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdin=asyncio.subprocess.PIPE,
    )
    try:
        yield started
    finally:
        if started.returncode is None:
            started.kill()
        await started.wait()


class Arrivals:
    """Waits for the first sign of the other process."""

    def __init__(self) -> None:
        self.inbox = Inbox(KEYS.delivery)
        self.samples: list[Sample] = []

    def there(self) -> bool:
        self.samples.extend(self.inbox.drain())
        return bool(self.samples)


def slowest_s(bus: ZenohBus, messages: Iterable[tuple[str, bytes]]) -> float:
    """Return the longest that the loop was held up by one message."""
    worst = 0.0
    for key, payload in messages:
        began_s = perf_counter()
        bus.publish(key, payload)
        worst = max(worst, perf_counter() - began_s)
    return worst


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_vehicle_that_hangs_holds_up_nobody_elses_setpoints() -> None:
    """Its link is filled to the brim; an event that waits for room must not hold up the rest.

    A put that waits would take five seconds; the bound leaves room for a busy machine.
    """
    tokens = Arrivals()
    async with ZenohBus(ROUTER, KEYS.delivery) as mission:
        await mission.watch(KEYS.alive(None), tokens.inbox)
        async with process(LISTENS, mission.endpoints[0]) as vehicle:
            await until(tokens.there)
            os.kill(vehicle.pid, signal.SIGSTOP)
            setpoint, order = KEYS.robot(1, Topic.SETPOINT), KEYS.robot(1, Topic.COMMAND)
            knowledge = KEYS.robot(1, Topic.KNOWLEDGE)
            rounds = [(setpoint, 300 * b"x"), (order, 300 * b"x")] * 8000
            assert slowest_s(mission, rounds) < 4.0
            assert slowest_s(mission, [(knowledge, 300_000 * b"x"), rounds[0]] * 50) < 4.0


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_flood_leaves_memory_bounded_and_the_newest_state() -> None:
    """While the loop is busy elsewhere, 60,000 messages arrive: none of them is lost track of."""
    count, most = 60_000, 500
    inbox = Inbox(KEYS.delivery, max_events=most)
    flood = Flooded(inbox)
    async with ZenohBus(ROUTER, KEYS.delivery) as mission:
        await mission.subscribe("falconer/red/robots/**", flood)
        async with process(FLOODS, mission.endpoints[0], str(count)):
            # Nothing is drained until the end of the flood has arrived.
            await until(lambda: flood.over)
        waiting = inbox.drain()
    by_topic: dict[str, list[int]] = {"state": [], "events": [], "nonsense": []}
    for sample in waiting:
        topic = sample.key.rsplit("/", 1)[1]
        if topic in by_topic:
            by_topic[topic].append(int(sample.payload.split(b".")[0]))
    events = by_topic["events"] + by_topic["nonsense"]
    assert sorted(events) == [n for n in range(count) if n % 3 > 0][:most], "the oldest"
    assert sorted(by_topic["state"]) == list(range(count - 30, count, 3)), "the newest of each"
    assert inbox.dropped == count * 2 // 3 - most
