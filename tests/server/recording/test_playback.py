import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from server.live.channel import RequestRefused
from server.live.outbox import Frame
from server.recording.playback import ReplayHost
from server.recording.reader import open_recording
from tests.server.recording.conftest import Flight
from tests.server.waiting import eventually


@asynccontextmanager
async def played(flight: Flight) -> AsyncIterator[tuple[ReplayHost, list[dict[str, Any]]]]:
    host, told = ReplayHost(open_recording(flight[0])), list[dict[str, Any]]()

    def receive(said: Frame) -> None:
        told.append(said.data)

    task = asyncio.create_task(host.run(receive))
    try:
        await host.request("prepare", {"mission": "m7"})
        yield host, told
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def pictures(told: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [said for said in told if said["type"] == "snapshot"]


@pytest.mark.asyncio
async def test_it_stands_until_started_then_plays_to_its_end(guided: Flight) -> None:
    async with played(guided) as (host, told):
        await eventually(lambda: bool(pictures(told)))
        assert pictures(told)[-1]["state"] == "paused"
        assert (await host.request("start"))["state"] == "running"
        await host.request("seek", {"time_s": 40.0, "speed": 20.0})
        await eventually(lambda: pictures(told)[-1]["time_s"] == 44.5)
        await eventually(lambda: pictures(told)[-1]["state"] == "paused")
        assert {said["mission"] for said in told} == {"m7"}
        assert pictures(told)[-1]["replay"] == {
            "duration_s": 44.5, "speed": 20.0, "recorded_state": "running",
        }  # fmt: skip


@pytest.mark.asyncio
async def test_seeking_shows_the_instant_and_tells_each_event_once(guided: Flight) -> None:
    async with played(guided) as (host, told):
        await host.request("seek", {"time_s": 30.0})
        await eventually(lambda: bool(pictures(told)) and pictures(told)[-1]["time_s"] == 30.0)
        await host.request("seek", {"time_s": 5.2})
        await eventually(lambda: pictures(told)[-1]["time_s"] == 5.0)
        await host.request("seek", {"time_s": 30.0})
        await eventually(lambda: pictures(told)[-1]["time_s"] == 30.0)
        seqs = [said["seq"] for said in told if said["type"] == "event"]
        assert seqs == sorted(set(seqs))
        assert seqs, "the comment at 10 s was told"


@pytest.mark.asyncio
async def test_it_goes_on_from_where_it_was_paused(guided: Flight) -> None:
    """However long it stood still: the time of the pause is not played."""
    async with played(guided) as (host, told):
        await host.request("seek", {"time_s": 30.0, "speed": 0.1})
        await eventually(lambda: bool(pictures(told)) and pictures(told)[-1]["time_s"] == 30.0)
        await asyncio.sleep(0.5)
        await host.request("resume")
        await eventually(lambda: pictures(told)[-1]["state"] == "running")
        first = next(said for said in pictures(told) if said["state"] == "running")
        assert first["time_s"] == 30.0


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("params", "word"),
    [
        ({"time_s": 45.0}, "44.5"),
        ({"time_s": -1.0}, "44.5"),
        ({"time_s": 1.0, "speed": 99.0}, "50"),
    ],
)
async def test_what_lies_outside_is_refused(
    guided: Flight, params: dict[str, float], word: str
) -> None:
    async with played(guided) as (host, _):
        with pytest.raises(RequestRefused, match=word):
            await host.request("seek", params)


@pytest.mark.asyncio
async def test_nothing_flies_so_nothing_is_steered(guided: Flight) -> None:
    async with played(guided) as (host, _):
        with pytest.raises(RequestRefused, match="replay"):
            await host.request("comment", {"text": "go", "author": "x"})
        assert (await host.request("result"))["steps"] == 90
        assert (await host.request("stop"))["result"]["steps"] == 90
