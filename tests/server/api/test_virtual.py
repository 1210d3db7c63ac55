"""Missions in lockstep and experiments over HTTP, in real processes."""

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from server.api.app import create_app
from server.api.library import ScenarioLibrary
from server.journal.database import DatabaseJournal
from server.journal.store import Store
from server.live.host import ProcessHost
from server.lockstep.assembly import Assembly
from server.lockstep.job import PAPER_LATENCY
from server.scenarios import library
from server.settings import Settings
from tests.server.api.serving import UNHURRIED, OpenDoor, StagedService
from tests.server.scripted import ScriptedHost

pytestmark = [pytest.mark.process]

API = "/api/v1"
STEPS = 60


def short(name: str = "hardware") -> dict[str, Any]:
    scenario = library.named(name).model_dump(mode="json", exclude_unset=True)
    return {**scenario, "steps": STEPS}


def host(_: object) -> ProcessHost:
    return ProcessHost((sys.executable, "-m", "server.lockstep.worker"))


@asynccontextmanager
async def serving(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[httpx.AsyncClient]:
    monkeypatch.setattr("server.api.service.slots", lambda: 1)
    settings = Settings(engine="sqp", request_rate=UNHURRIED)
    journal = DatabaseJournal(Store(f"sqlite:///{folder}/journal.db"))
    service = StagedService(ScenarioLibrary(settings), host, ScriptedHost, journal)
    app = create_app(settings, service, door=OpenDoor())
    transport = httpx.ASGITransport(app=app)
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000") as client,
    ):
        yield client


async def states_of(client: httpx.AsyncClient) -> tuple[str, ...]:
    """All missions' states at one instant."""
    return tuple([each["state"] for each in (await client.get(f"{API}/missions")).json()])


@pytest.mark.asyncio
async def test_lockstep_missions_wait_for_their_turn_and_repeat_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with serving(tmp_path, monkeypatch) as client:
        body = {"scenario": short(), "clock": "lockstep", "seed": 5}
        for _ in range(3):
            assert (await client.post(f"{API}/missions", json=body)).status_code == 201
        for mission in ("m1", "m2", "m3"):
            started = await client.post(f"{API}/missions/{mission}/start")
            assert started.json()["state"] == "queued"
        again = await client.post(f"{API}/missions/m2/start")  # idempotent
        assert again.json()["state"] == "queued"
        stopped = await client.post(f"{API}/missions/m3/stop")  # never had its turn
        assert stopped.json()["state"] == "ended"
        refused = await client.post(f"{API}/missions/m2/comments", json={"text": "No."})
        assert refused.status_code == 409
        states: list[tuple[str, ...]] = []

        def over() -> bool:
            return bool(states) and states[-1] == ("ended", "ended", "ended")

        for _ in range(3000):
            states.append(await states_of(client))
            assert states[-1][:2].count("running") <= 1
            if over():
                break
            await asyncio.sleep(0.05)
        assert over()
        results = [(await client.get(f"{API}/missions/{m}/result")).json() for m in ("m1", "m2")]
        chosen = library.inline(short()).varied(seed=5)
        expected = await Assembly(
            chosen.mission_setup("sqp"), chosen.world_setup(), "mock", PAPER_LATENCY, Settings()
        ).run((), lambda _: None)
        for key in ("accumulated_trace", "trajectory_length_m", "sensing_attacks", "steps"):
            assert results[0][key] == results[1][key] == expected[key]
        cards = (await client.get(f"{API}/missions/m1/decisions")).json()["decisions"]
        assert len(cards) >= results[0]["action_llm"]["calls"] > 0
        history = (await client.get(f"{API}/missions/m1/history")).json()["samples"]
        assert history[-1]["time_s"] > 0.0
        snapshot = (await client.get(f"{API}/missions/m1/snapshot")).json()
        assert snapshot["state"] == "ended"
        assert 0 < snapshot["tick"] < STEPS
        assert (await client.get(f"{API}/missions/m3/result")).status_code == 409


@pytest.mark.asyncio
async def test_an_experiment_is_begun_followed_and_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    async with serving(tmp_path, monkeypatch) as client:
        body = {"scenario": "ablation", "seeds": 1, "steps": 10, "llms": ["mock"]}
        begun = await client.post(f"{API}/experiments", json=body)
        assert begun.status_code == 201, begun.text
        assert begun.json()["runs"] == 5
        waiting = await client.post(f"{API}/experiments", json=body)
        stopped = await client.post(f"{API}/experiments/{waiting.json()['id']}/stop")
        assert stopped.json()["state"] == "stopped"
        told: dict[str, Any] = {}
        for _ in range(5000):
            told = (await client.get(f"{API}/experiments/e1")).json()
            if told["state"] not in ("queued", "running"):
                break
            await asyncio.sleep(0.05)
        assert told["state"] == "done", told["error"]
        assert told["done"] == 5
        assert told["result"]
        small = {"kind": "scaling", "largest": 2, "seeds": 1, "steps": 10}
        assert (await client.post(f"{API}/experiments", json=small)).json()["runs"] == 1
        for _ in range(5000):
            told = (await client.get(f"{API}/experiments/e3")).json()
            if told["state"] not in ("queued", "running"):
                break
            await asyncio.sleep(0.05)
        assert told["state"] == "done", told["error"]
        assert told["result"]["experiment"] == "scaling"
        page = (await client.get(f"{API}/experiments?after=1&limit=5")).json()
        assert [experiment["id"] for experiment in page["experiments"]] == ["e2", "e3"]
        for wrong in ({"seeds": 0}, {"llms": ["http://10.0.0.1"]}, {"scenario": "nowhere"}):
            answer = await client.post(f"{API}/experiments", json=body | wrong)
            assert answer.status_code == 422
        assert (await client.get(f"{API}/experiments/e9")).status_code == 404
