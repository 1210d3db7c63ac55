"""A team on two sites, in short: the link between them is cut and healed, slow and lossy.

The sites are network namespaces where such can be made, otherwise two loopback addresses.
"""

import asyncio
import json
import signal
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from benchmarks.field.forwarder import Forwarder
from benchmarks.field.measure import Figures, Outage, Stretch, broken
from benchmarks.field.sites import Separation, namespace_maker
from benchmarks.field.ways import PacketWay, StreamWay, Weather
from tests.patience import busy, patience_s

LONGEST_S = 400.0
CLOSING_S = 60.0

POOR = Stretch(
    seconds=10.0,
    setpoints={21: 90},
    longest_wait_s={21: 0.4},
    flying={21: 1.0},
    refused={21: 0},
    ticks=100,
    missed=0,
)
OUTAGE = Outage(
    held_s=0.7,
    lost_s=1.1,
    covered_s=1.1,
    fastest_m_s=0.0,
    modes=["holding"],
    ticks=100,
    back_s=1.5,
    met_s=1.4,
)
FINE = Figures(
    Separation.LOOPBACK, poor=POOR, outages=[OUTAGE], lost=9, tracked=["tracked"], model_calls=3
)


async def _flown(root: Path) -> dict[str, Any]:
    """Run the program; interrupted, it ends what it started."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "benchmarks.field", "--quick"),
        cwd=root,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    talk = asyncio.create_task(process.communicate())
    try:
        async with asyncio.timeout(LONGEST_S):
            said, errors = await asyncio.shield(talk)
    except TimeoutError:
        process.send_signal(signal.SIGINT)
        async with asyncio.timeout(CLOSING_S):
            said, errors = await talk
        raise AssertionError(f"not done in time: {errors.decode()}") from None
    assert said, errors.decode()
    told: dict[str, Any] = json.loads(said)
    return told


@pytest.mark.process
@pytest.mark.timeout(LONGEST_S + 2 * CLOSING_S)
@pytest.mark.asyncio
async def test_a_link_between_two_sites_is_cut_and_healed_slow_and_lossy(root: Path) -> None:
    before, maker = busy(), await asyncio.to_thread(namespace_maker)
    told = await _flown(root)
    figures = TypeAdapter(Figures).validate_python(told["figures"])
    assert figures.separation is (Separation.LOOPBACK if maker is None else Separation.NAMESPACES)
    load = max(before, busy())
    assert broken(figures, hold_within_s=load * patience_s(), flying=0.8 / load) == []
    assert len(figures.outages) == 1
    assert figures.poor is not None
    assert min(figures.poor.setpoints.values()) > 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ended": ["router away"]}, "router away did not last"),
        ({"outages": [replace(OUTAGE, held_s=1.4)]}, "held only after 1.40 s"),
        ({"outages": [replace(OUTAGE, modes=["flying", "holding"])]}, "flying"),
        ({"outages": [replace(OUTAGE, fastest_m_s=0.5)]}, "0.50 m/s"),
        ({"outages": [replace(OUTAGE, ticks=0)]}, "stood still"),
        ({"poor": replace(POOR, flying={21: 0.5})}, "robot 21 flew 50 %"),
        ({"tracked": ["tracked", "dropped"]}, "dropped"),
        ({"lost": 0}, "lost nothing"),
        ({"model_calls": 0}, "never asked"),
    ],
)
def test_a_broken_promise_is_told(change: dict[str, Any], words: str) -> None:
    assert broken(FINE) == []
    (found,) = broken(replace(FINE, **change))
    assert words in found


def test_packets_are_late_or_lost_and_keep_their_order() -> None:
    weather = Weather(delay_s=0.1, loss=0.05)
    way, same = PacketWay(weather, 7), PacketWay(weather, 7)
    dues = [way.due_s(0.001 * n) for n in range(10_000)]
    assert dues == [same.due_s(0.001 * n) for n in range(10_000)], "one seed, one link"
    arrived = [(0.001 * n, due) for n, due in enumerate(dues) if due is not None]
    assert all(due == pytest.approx(sent + 0.1) for sent, due in arrived)
    assert way.lost + way.carried == 10_000
    assert 0.04 < way.lost / 10_000 < 0.06
    weather.delay_s = 0.0
    assert (way.due_s(10.0) or 0.0) >= arrived[-1][1], "nothing overtakes what is under way"
    weather.opened.clear()
    assert [way.due_s(20.0) for _ in range(100)] == [None] * 100


def test_a_stream_loses_nothing_but_waits() -> None:
    way = StreamWay(Weather(delay_s=0.1, loss=0.2), 7)
    dues = [way.due_s(0.01 * n) for n in range(1000)]
    assert dues == sorted(dues)
    waits = [due - 0.01 * n for n, due in enumerate(dues)]
    assert min(waits) == pytest.approx(0.1)
    assert max(waits) > 0.3
    assert way.lost > 0


@pytest.mark.sockets
@pytest.mark.asyncio
async def test_a_forwarder_carries_waits_while_cut_and_ends_with_either_end() -> None:
    async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while piece := await reader.read(100):
            writer.write(piece)
        writer.close()

    weather = Weather(delay_s=0.02)
    server = await asyncio.start_server(echo, "127.0.0.1", 0)
    to = ("127.0.0.1", server.sockets[0].getsockname()[1])
    async with server, Forwarder(weather, to, 0) as link:
        reader, writer = await asyncio.open_connection("127.0.0.1", link.port)
        began_s = asyncio.get_running_loop().time()
        writer.write(b"there and back")
        assert await reader.readexactly(14) == b"there and back"
        assert asyncio.get_running_loop().time() - began_s >= 0.04
        weather.opened.clear()
        writer.write(b"later")
        reading = asyncio.create_task(reader.readexactly(5))
        assert not (await asyncio.wait((reading,), timeout=0.2))[0]
        weather.opened.set()
        assert await reading == b"later"
        writer.close()
        await writer.wait_closed()
        assert await reader.read() == b""
