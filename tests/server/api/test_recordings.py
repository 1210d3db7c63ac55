import asyncio
import shutil
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest

from server.api.app import create_app
from server.api.archive import recording_of
from server.api.catalogue import Definition
from server.api.library import ScenarioLibrary
from server.api.models import Clock
from server.journal.database import DatabaseJournal
from server.journal.store import Store
from server.live.host import Host
from server.recording.playback import ReplayHost
from server.settings import Settings
from tests.server.api.serving import UNHURRIED, OpenDoor, StagedService
from tests.server.api.test_missions import API, refused, until
from tests.server.recording.flown import fly
from tests.server.scripted import ScriptedHost


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    fly(folder / "flight.mcap", llm="none", steps=40)
    (folder / "broken.mcap").write_bytes(b"\x89MCAP0\r\n")
    (folder / "notes.txt").write_text("no recording")
    return folder


def host(definition: Definition) -> Host:
    if definition.clock is Clock.REPLAY:
        return ReplayHost(recording_of(definition))
    return ScriptedHost(definition)


@asynccontextmanager
async def serving(folder: Path | None) -> AsyncIterator[httpx.AsyncClient]:
    settings = Settings(recordings=folder, request_rate=UNHURRIED)
    journal = DatabaseJournal(Store(f"sqlite:///{tempfile.mkdtemp()}/journal.db"))
    service = StagedService(ScenarioLibrary(settings), host, ScriptedHost, journal)
    transport = httpx.ASGITransport(
        app=create_app(settings, service, door=OpenDoor()), raise_app_exceptions=False
    )
    async with (
        service,
        httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000") as client,
    ):
        yield client


@pytest.mark.asyncio
async def test_recordings_are_listed_broken_ones_with_the_reason(folder: Path) -> None:
    async with serving(folder) as client:
        listed = {one["name"]: one for one in (await client.get(f"{API}/recordings")).json()}
    assert set(listed) == {"flight.mcap", "broken.mcap"}
    assert listed["flight.mcap"]["scenario"] == "ablation"
    assert listed["flight.mcap"]["complete"] is True
    assert listed["flight.mcap"]["error"] is None
    assert "cut off" in listed["broken.mcap"]["error"]


@pytest.mark.asyncio
async def test_without_a_folder_there_are_none(folder: Path) -> None:
    async with serving(None) as client:
        assert (await client.get(f"{API}/recordings")).json() == []
        answer = await client.post(f"{API}/recordings/flight.mcap/replay")
        assert "FALCONER_RECORDINGS" in refused(answer, 404, "recording_unknown")["message"]


@pytest.mark.asyncio
async def test_a_replay_is_a_mission_that_can_be_wound(folder: Path) -> None:
    async with serving(folder) as client:
        answer = await client.post(f"{API}/recordings/flight.mcap/replay")
        assert answer.status_code == 201, answer.text
        mission = answer.json()["id"]
        assert answer.json()["clock"] == "replay"
        await until(client, f"/missions/{mission}/snapshot", lambda s: "tick" in s)
        await client.post(f"{API}/missions/{mission}/pause")
        answer = await client.post(f"{API}/missions/{mission}/seek", json={"time_s": 12.5})
        assert answer.status_code == 200, answer.text
        await until(client, f"/missions/{mission}/snapshot", lambda s: s["time_s"] == 12.5)
        answer = await client.post(f"{API}/missions/{mission}/seek", json={"time_s": 99.0})
        assert "19.5" in refused(answer, 409, "out_of_range")["message"]
        answer = await client.post(f"{API}/missions/{mission}/comments", json={"text": "hello"})
        refused(answer, 409, "replay")


@pytest.mark.asyncio
async def test_a_recording_that_two_ask_for_at_once_is_shown_once(folder: Path) -> None:
    async with serving(folder) as client:
        url = f"{API}/recordings/flight.mcap/replay"
        answers = await asyncio.gather(*(client.post(url) for _ in range(3)))
        assert {answer.status_code for answer in answers} == {201}
        assert {answer.json()["id"] for answer in answers} == {"m1"}


@pytest.mark.asyncio
async def test_a_fork_over_http_sets_both_stories_beside_each_other(folder: Path) -> None:
    async with serving(folder) as client:
        mission = (await client.post(f"{API}/recordings/flight.mcap/replay")).json()["id"]
        body = {"at_s": 10.0, "llm": "none"}
        url = f"{API}/missions/{mission}/fork"
        answers = await asyncio.gather(*(client.post(url, json=body) for _ in range(2)))
        answer, other = sorted(answers, key=lambda each: each.status_code)
        refused(other, 429, "busy")
        assert answer.status_code == 200, answer.text
        story = answer.json()
        assert story["forked"]["accumulated_trace"] == pytest.approx(
            story["recorded"]["accumulated_trace"], abs=1e-4
        )
        answer = await client.post(url, json={"at_s": 99.0, "llm": "none"})
        assert "19.5 s" in refused(answer, 409, "fork_refused")["message"]
        answer = await client.post(url, json={"at_s": 1.0, "llm": "http://evil.example"})
        refused(answer, 422, "invalid_request")
        answer = await client.post(url, json={"at_s": 1.0, "llm": "gpt"})
        refused(answer, 422, "llm_unknown")


@pytest.mark.asyncio
async def test_what_is_not_recorded_cannot_be_forked(folder: Path) -> None:
    async with serving(folder) as client:
        answer = await client.post(f"{API}/missions", json={"scenario": "demo", "llm": "none"})
        mission = answer.json()["id"]
        answer = await client.post(f"{API}/missions/{mission}/fork", json={"at_s": 1.0})
        refused(answer, 409, "not_recorded")


@pytest.mark.asyncio
@pytest.mark.parametrize("name", ["..%2Fsecret.mcap", ".hidden.mcap", "flight", "nothing.mcap"])
async def test_names_do_not_lead_out_of_the_folder(folder: Path, name: str) -> None:
    shutil.copy(folder / "flight.mcap", folder.parent / "secret.mcap")
    async with serving(folder) as client:
        answer = await client.post(f"{API}/recordings/{name}/replay")
        assert answer.status_code in {404, 422}
