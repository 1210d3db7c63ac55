"""Scenarios that are uploaded: checked, listed, flown, kept over a restart."""

import asyncio
from typing import Any

import httpx
import pytest

from server.api.library import ScenarioLibrary
from server.journal.database import DatabaseJournal
from server.journal.store import Store
from server.scenarios import library
from server.settings import Settings
from tests.server.api.serving import Stage, StagedService, client_of

API = "/api/v1"


def scenario(**changes: Any) -> dict[str, Any]:
    known = library.named("hardware").model_dump(mode="json", exclude_unset=True)
    return {**known, "name": "my-own", **changes}


def staged(stage: Stage) -> Stage:
    """Give a stage the real library of scenarios."""
    journal = DatabaseJournal(Store(f"sqlite:///{stage.folder / 'journal.db'}"))
    stage.service = StagedService(ScenarioLibrary(Settings()), stage.planner, stage.world, journal)
    return stage


async def names(client: httpx.AsyncClient) -> list[str]:
    return [known["name"] for known in (await client.get(f"{API}/scenarios")).json()]


@pytest.mark.asyncio
async def test_an_uploaded_scenario_is_listed_flown_kept_and_removed() -> None:
    stage = staged(Stage())
    url = f"{API}/scenarios"
    async with client_of(stage.app(), stage) as client:
        made = await client.post(url, json={"scenario": scenario()})
        assert made.status_code == 201, made.text
        assert made.json()["robots"] == 2
        again = await client.post(url, json={"scenario": scenario()})
        assert again.json()["error"]["code"] == "scenario_exists"
        built_in = await client.post(url, json={"scenario": scenario(name="demo")})
        assert built_in.status_code == 409
        assert "my-own" in await names(client)
        mission = await client.post(f"{API}/missions", json={"scenario": "my-own"})
        assert mission.json()["scenario"] == "my-own"
    later = staged(Stage(folder=stage.folder))
    async with client_of(later.app(), later) as client:
        assert (await client.get(f"{url}/my-own")).json() == scenario()
        assert (await client.delete(f"{url}/my-own")).status_code == 204
        assert (await client.delete(f"{url}/my-own")).status_code == 404
        assert (await client.delete(f"{url}/demo")).status_code == 404
        assert "my-own" not in await names(client)
    last = staged(Stage(folder=stage.folder))
    async with client_of(last.app(), last) as client:
        assert "my-own" not in await names(client)
        assert [m["id"] for m in (await client.get(f"{API}/missions?after=0")).json()] == ["m1"]
        assert (await client.get(f"{API}/missions?after=1")).json() == []


@pytest.mark.asyncio
async def test_of_two_uploads_at_once_under_one_name_one_is_kept() -> None:
    stage = staged(Stage())
    async with client_of(stage.app(), stage) as client:
        url, body = f"{API}/scenarios", {"scenario": scenario()}
        answers = await asyncio.gather(*(client.post(url, json=body) for _ in range(3)))
        assert sorted(answer.status_code for answer in answers) == [201, 409, 409]


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"robots": []}, "robots"),
        ({"name": "../up"}, "name"),
        ({"tick_s": -1}, "tick_s"),
        ({"nonsense": 1}, "nonsense"),
    ],
)
async def test_what_cannot_be_flown_is_refused_by_name(changes: dict[str, Any], said: str) -> None:
    stage = staged(Stage())
    async with client_of(stage.app(), stage) as client:
        answer = await client.post(f"{API}/scenarios", json={"scenario": scenario(**changes)})
        assert answer.status_code == 422
        assert answer.json()["error"]["code"] == "scenario_invalid"
        assert said in answer.json()["error"]["message"]
