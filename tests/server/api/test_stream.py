import asyncio
import json
from typing import Any

import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from server.api.models import MissionRequest
from server.api.stream import CLOSE_GOING_AWAY, CLOSE_NOT_UNDERSTOOD, CLOSE_TOO_SLOW
from server.encoding import EventKind, Severity
from tests.patience import PATIENCE_S
from tests.server.api.serving import Stage, served
from tests.server.waiting import eventually

REQUEST = MissionRequest(scenario="scripted")


def url(address: str, mission: str = "m1") -> str:
    return f"ws://{address}/api/v1/missions/{mission}/stream"


async def received(socket: ClientConnection) -> dict[str, Any]:
    said: dict[str, Any] = json.loads(await socket.recv())
    return said


async def read_on(socket: ClientConnection) -> None:
    while True:
        await socket.recv()


@pytest.mark.asyncio
async def test_snapshots_and_events_come_as_they_happen() -> None:
    stage = Stage()
    async with served(stage.app()) as address:
        await stage.service.create(REQUEST, "operator")
        async with connect(url(address)) as socket:  # opened before it flies
            await stage.service.start("m1", "operator")
            first = await received(socket)
            assert first["type"] == "snapshot"
            await stage.service.comment("m1", "Focus.", "operator")
            while (said := await received(socket))["type"] != "event":
                assert said["time_s"] > first["time_s"]
            assert said["kind"] == "comment"
            assert said["seq"] == 1


@pytest.mark.asyncio
async def test_a_late_comer_sees_the_last_snapshot_of_an_ended_mission() -> None:
    stage = Stage()
    async with served(stage.app()) as address:
        await stage.service.create(REQUEST, "operator")
        await stage.service.start("m1", "operator")
        await eventually(lambda: stage.service.snapshot("m1") is not None)
        await stage.service.stop("m1", "operator")
        async with connect(url(address)) as socket:
            assert (await received(socket))["state"] == "ended"


@pytest.mark.asyncio
async def test_an_unknown_mission_is_refused_in_the_one_shape() -> None:
    stage = Stage()
    async with served(stage.app()) as address:
        with pytest.raises(InvalidStatus) as refused:
            async with connect(url(address, "m9")):
                pass
    assert refused.value.response.status_code == 404
    assert refused.value.response.body is not None
    assert json.loads(refused.value.response.body)["error"]["code"] == "mission_unknown"


@pytest.mark.asyncio
async def test_a_removed_mission_closes_its_streams() -> None:
    stage = Stage()
    async with served(stage.app()) as address:
        await stage.service.create(REQUEST, "operator")
        async with connect(url(address)) as socket:
            await eventually(lambda: stage.service.readers("m1") == 1)
            await stage.service.delete("m1", "operator")
            with pytest.raises(ConnectionClosed) as closed:
                await socket.recv()
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == CLOSE_GOING_AWAY
    assert "removed" in closed.value.rcvd.reason


@pytest.mark.asyncio
async def test_a_client_that_talks_is_closed() -> None:
    stage = Stage()
    async with served(stage.app()) as address:
        await stage.service.create(REQUEST, "operator")
        async with connect(url(address)) as socket:
            await socket.send("hello")
            with pytest.raises(ConnectionClosed) as closed:
                await socket.recv()
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == CLOSE_NOT_UNDERSTOOD


@pytest.mark.asyncio
async def test_a_stalled_client_is_dropped_and_nobody_else_notices() -> None:
    stage = Stage()
    async with served(stage.app()) as address:
        await stage.service.create(REQUEST, "operator")
        await stage.service.start("m1", "operator")
        async with (
            connect(url(address), compression=None) as quick,
            connect(url(address), max_queue=1, ping_interval=None, compression=None) as stalled,
        ):
            await eventually(lambda: stage.service.readers("m1") == 2)
            stalled.transport.pause_reading()
            seqs = []
            padding = "x" * 60_000
            for _ in range(600):  # 36 MB, more than sockets buffer
                stage.planners[0].event(EventKind.LOOP, Severity.INFO, "busy", padding=padding)
                while (said := await received(quick))["type"] != "event":
                    pass
                seqs.append(said["seq"])
            assert seqs == list(range(1, 601))
            assert stage.service.readers("m1") == 1
            stalled.transport.resume_reading()
            with pytest.raises(ConnectionClosed) as closed:
                await read_on(stalled)
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == CLOSE_TOO_SLOW


@pytest.mark.asyncio
async def test_fifty_clients_read_the_same() -> None:
    stage = Stage()
    async with served(stage.app()) as address:
        await stage.service.create(REQUEST, "operator")
        await stage.service.start("m1", "operator")

        async def read_ten() -> list[float]:
            async with connect(url(address), open_timeout=PATIENCE_S) as socket:
                return [(await received(socket))["time_s"] for _ in range(10)]

        read = await asyncio.gather(*(read_ten() for _ in range(50)))
        assert all(times == sorted(set(times)) for times in read)
        await eventually(lambda: stage.service.readers("m1") == 0)
