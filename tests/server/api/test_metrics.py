"""What Prometheus is told, and that the page and the dashboard speak of nothing else."""

import json
import re
from pathlib import Path

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families
from structlog.testing import capture_logs

from server.api.catalogue import Definition
from server.api.models import Clock, MissionRequest
from server.live.channel import frame
from server.mission.setup import GateMode
from tests.server.api.serving import Stage, client_of
from tests.server.journal.keeping import full_disk
from tests.server.waiting import eventually

VITALS = {
    "type": "vitals",
    "process": {"resident_bytes": 1e8, "tasks": 9, "threads": 4},
    "llm": {
        "task": {
            "calls": 3, "tries": 4, "valid": 3, "adopted": 2,
            "tokens_in": 900, "tokens_out": 90, "seconds": 4.5,
        }
    },
    "counters": {"bus_messages": 7},
}  # fmt: skip


def figures(answer: httpx.Response) -> dict[tuple[str, str], float]:
    """Return every sample by its name and its one label."""
    assert answer.status_code == 200
    return {
        (sample.name, next(iter(sample.labels.values()), "")): sample.value
        for family in text_string_to_metric_families(answer.text)
        for sample in family.samples
    }


async def told(stage: Stage, client: httpx.AsyncClient) -> dict[tuple[str, str], float]:
    await stage.service.create(MissionRequest(scenario="scripted"), "test")
    await stage.service.start("m1", "test")
    await eventually(lambda: stage.service.snapshot("m1") is not None)
    stage.planners[0]._receive(frame(VITALS))
    with stage.service.frames("m1"):
        return figures(await client.get("/metrics"))


@pytest.mark.asyncio
async def test_loops_models_bus_clients_journal_and_processes_are_told() -> None:
    stage = Stage()
    async with client_of(stage.app(), stage) as client:
        found = await told(stage, client)
        assert found["falconer_loop_rate_hz", "optimizer"] == 10.0
        assert found["falconer_llm_tokens_in_total", "task"] == 900
        assert found["falconer_dropped_total", "bus_messages"] == 7
        assert found["falconer_stream_clients", ""] == 1
        assert found["falconer_robots", "jammed"] == 1
        assert found["falconer_missions", "running"] == 1
        assert found["falconer_journal_available", ""] == 1
        assert found["falconer_journal_entries_total", ""] >= 1
        assert found["falconer_process_resident_bytes", "mission"] == 1e8
        assert found["falconer_process_resident_bytes", "web"] > 1e7
        assert found["falconer_process_tasks", "web"] >= 1


@pytest.mark.asyncio
async def test_a_replay_is_not_taken_for_the_mission_that_flies() -> None:
    stage = Stage()
    shown = Definition("scripted", "none", 0, Clock.REPLAY, GateMode.AUTO, {"p": 1}, None)
    async with client_of(stage.app(), stage) as client:
        mission = (await stage.service.add(shown, "test")).id
        await stage.service.start(mission, "test")
        await eventually(lambda: stage.service.snapshot(mission) is not None)
        found = figures(await client.get("/metrics"))
        assert found["falconer_missions", "running"] == 1
        assert ("falconer_trace", "") not in found


@pytest.mark.asyncio
async def test_a_journal_that_is_away_shows() -> None:
    stage = Stage()
    with capture_logs():
        async with client_of(stage.app(), stage) as client:
            assert (await client.get("/readyz")).json()["status"] == "ready"
            with full_disk():
                await client.post("/api/v1/missions", json={"scenario": "scripted"})
                assert figures(await client.get("/metrics"))["falconer_journal_available", ""] == 0
                ready = (await client.get("/readyz")).json()
                assert ready["status"] == "degraded"
                assert "journal" in ready["reason"]


@pytest.mark.asyncio
async def test_the_page_and_the_dashboard_speak_of_what_is_told(root: Path) -> None:
    stage = Stage()
    async with client_of(stage.app(), stage) as client:
        names = {name for name, _ in await told(stage, client)}
    name = re.compile(r"falconer_[a-z_]+")
    page = (root / "docs" / "reference" / "metrics.md").read_text("utf-8")
    assert set(name.findall(page)) == names
    dashboard = json.loads((root / "docs" / "grafana.json").read_text("utf-8"))
    asked = {
        found
        for panel in dashboard["panels"]
        for target in panel["targets"]
        for found in name.findall(target["expr"])
    }
    assert asked <= names
    assert len(asked) > 20
