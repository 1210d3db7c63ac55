"""What the service keeps in its journal, and what happens when it cannot."""

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from structlog.testing import capture_logs

from server.api.catalogue import Definition
from server.api.models import MissionRequest
from server.api.recovery import AfterCrash
from server.api.service import MissionService
from server.encoding import EventKind, MissionState, Severity
from server.journal.database import DatabaseJournal
from server.journal.entry import Entry, EntryKind, Sealed
from server.journal.store import Store
from server.live.channel import RequestTimeout
from tests.server.api.serving import Stage, StagedService, client_of
from tests.server.journal.keeping import address, full_disk, verified
from tests.server.scripted import ScriptedCatalogue, ScriptedHost
from tests.server.waiting import eventually

API = "/api/v1"
REQUEST = MissionRequest(scenario="scripted")


async def flying(stage: Stage) -> None:
    await stage.service.create(REQUEST, "operator")
    await stage.service.start("m1", "operator")
    await eventually(lambda: stage.service.snapshot("m1") is not None)


def told(client_answer: httpx.Response) -> list[str]:
    return [event["text"] for event in client_answer.json()["events"]]


@pytest.mark.asyncio
async def test_without_a_journal_comments_are_refused_and_everything_else_goes_on() -> None:
    stage = Stage()
    with capture_logs():
        async with client_of(stage.app(), stage) as client:
            await flying(stage)
            url = f"{API}/missions/m1"
            before = await client.post(f"{url}/comments", json={"text": "before"})
            assert before.status_code == 201
            with full_disk():
                refused = await client.post(f"{url}/comments", json={"text": "during"})
                assert refused.status_code == 503
                assert refused.json()["error"]["code"] == "journal_unavailable"
                said = [params for op, params in stage.planners[0].requests if op == "comment"]
                assert [params["text"] for params in said] == ["before"]
                assert (await client.post(f"{url}/hold")).json()["state"] == "held"
                assert (await client.post(f"{url}/resume")).json()["state"] == "running"
                created = await client.post(f"{API}/missions", json={"scenario": "scripted"})
                assert created.status_code == 503
                time_s = (await client.get(f"{url}/snapshot")).json()["time_s"]
                await eventually(lambda: (stage.service.mission("m1").time_s or 0.0) > time_s)
                events = told(await client.get(f"{url}/events"))
                assert any("journal is not available" in text for text in events)
            await eventually(lambda: stage.service.journal.available)
            after = await client.post(f"{url}/comments", json={"text": "after"})
            assert after.status_code == 201
            events = told(await client.get(f"{url}/events"))
            assert any("journal works again" in text for text in events)
            await stage.service.comment("m1", "A commit flushes the rest.", "operator")
            found = await stage.service.chronicle.events("m1", 0, 1000)
            assert [event["text"] for event in found][: len(events)] == events
            shutil.copytree(stage.folder, stage.folder / "copy")
            entries = await stage.service.chronicle.journal.read("m1", (EntryKind.COMMENT,))
            assert [entry.data["text"] for entry in entries][:2] == ["before", "after"]
            assert (await verified(address(stage.folder / "copy"))).problems == ()


@pytest.mark.asyncio
async def test_events_that_memory_has_forgotten_come_from_the_journal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("server.api.record.EVENTS_KEPT", 10)
    stage = Stage()
    async with client_of(stage.app(), stage) as client:
        await flying(stage)
        for number in range(1, 101):
            stage.planners[0].event(EventKind.LOOP, Severity.INFO, f"event {number}")
        await stage.service.comment("m1", "A commit flushes what was told before.", "operator")
        seen: list[int] = []
        after = 0
        while True:
            answer = await client.get(f"{API}/missions/m1/events?after={after}&limit=7")
            page: dict[str, Any] = answer.json()
            if not page["events"]:
                break
            seen += [event["seq"] for event in page["events"]]
            after = page["next_after"]
        assert seen[:100] == list(range(1, 101))
        assert seen == list(range(1, len(seen) + 1))


@pytest.mark.asyncio
async def test_history_has_one_sample_per_second() -> None:
    stage = Stage()
    async with client_of(stage.app(), stage) as client:
        await flying(stage)
        for second in range(100, 130):
            stage.planners[0].say(float(second))
            stage.planners[0].say(second + 0.5)
        await stage.service.comment("m1", "flush", "operator")
        answer = await client.get(f"{API}/missions/m1/history?limit=1000")
        times = [s["time_s"] for s in answer.json()["samples"] if 100 <= s["time_s"] < 130]
        assert len(times) == 30
        assert answer.json()["samples"][0]["weights"]["tracking"] == 10.0
        page = await client.get(f"{API}/missions/m1/history?after=3&limit=2")
        assert [sample["seq"] for sample in page.json()["samples"]] == [4, 5]
        assert page.json()["next_after"] == 5


@pytest.mark.asyncio
async def test_the_journal_names_authors_and_no_secret() -> None:
    stage = Stage()
    async with client_of(stage.app(), stage):
        await flying(stage)
        await stage.service.comment("m1", "Focus.", "alice")
        await stage.service.hold("m1", "bob")
        await stage.service.stop("m1", "carol")
        kinds = (EntryKind.MISSION, EntryKind.COMMENT, EntryKind.STATE)
        entries = await stage.service.chronicle.journal.read("m1", kinds)
        by = {(entry.kind, entry.author) for entry in entries}
        assert {("mission", "operator"), ("comment", "alice")} <= by
        assert {("state", "bob"), ("state", "carol")} <= by
        assert "bus" not in entries[0].data["definition"]["planner"]


def crashed(stage: Stage, folder: Path) -> Stage:
    """Return a stage on what a kill -9 would leave now."""
    shutil.copytree(stage.folder, folder)
    return Stage(folder=folder)


@pytest.mark.asyncio
async def test_after_a_crash_missions_come_back(tmp_path: Path) -> None:
    stage = Stage()
    async with stage.service:
        await flying(stage)
        await stage.service.comment("m1", "Focus.", "alice")
        card = {"id": "d7", "status": "adopted", "source": "task_llm"}
        stage.planners[0].event(EventKind.DECISION, Severity.INFO, "Decided.", decision=card)
        await stage.service.create(REQUEST, "operator")  # m2 has not started
        await stage.service.create(REQUEST, "operator")
        await stage.service.delete("m3", "operator")
        after = crashed(stage, tmp_path / "crashed")
    async with client_of(after.app(), after) as client:
        found = after.service.mission("m1")
        assert found.state == "held"
        held = await client.post(f"{API}/missions/m1/hold")
        assert held.status_code == 200
        await eventually(lambda: after.service.snapshot("m1") is not None)
        missions = (await client.get(f"{API}/missions")).json()
        assert [(m["id"], m["state"]) for m in missions] == [("m1", "held"), ("m2", "created")]
        assert [comment.text for comment in after.service.comments("m1")] == ["Focus."]
        assert card in after.service.decisions("m1", 0, 10)
        prepared = next(params for op, params in after.planners[0].requests if op == "prepare")
        assert prepared["decisions"] >= 1  # new cards take other numbers
        created = await client.post(f"{API}/missions", json={"scenario": "scripted"})
        assert created.json()["id"] == "m4"
        said = await client.post(f"{API}/missions/m1/comments", json={"text": "Next."})
        assert said.json()["id"] == "c2"


@pytest.mark.asyncio
async def test_a_start_that_was_acknowledged_outlasts_a_crash(tmp_path: Path) -> None:
    stage = Stage()
    async with stage.service:
        await stage.service.create(REQUEST, "operator")
        await stage.service.start("m1", "operator")
        after = crashed(stage, tmp_path / "crashed")
    async with after.service:
        assert after.service.mission("m1").state == "held"


@pytest.mark.asyncio
async def test_after_an_orderly_end_nothing_goes_on() -> None:
    stage = Stage()
    async with stage.service:
        await flying(stage)
    again = Stage(folder=stage.folder)
    async with again.service:
        found = again.service.mission("m1")
        assert (found.state, found.reason) == ("ended", "the server was shut down")
        assert again.planners == []


@dataclass
class Deaf(ScriptedHost):
    """Does not answer one kind of request."""

    to: str = "hold"

    async def request(
        self, op: str, params: Mapping[str, Any] | None = None, *, timeout_s: float = 5.0
    ) -> dict[str, Any]:
        if op == self.to:
            raise RequestTimeout(f"no answer to {op} within {timeout_s:g} s")
        return await super().request(op, params, timeout_s=timeout_s)


def deaf(stage: Stage, to: str) -> MissionService:
    """Return a service on a stage's journal, which resumes missions whose planners are deaf."""

    def planner(definition: Definition) -> ScriptedHost:
        stage.planners.append(Deaf(definition, period_s=stage.period_s, to=to))
        return stage.planners[-1]

    journal = DatabaseJournal(Store(address(stage.folder)))
    return StagedService(
        ScriptedCatalogue(), planner, stage.world, journal, AfterCrash.RESUME_SIMULATED
    )


@pytest.mark.asyncio
async def test_a_mission_that_cannot_be_held_after_a_crash_does_not_fly(tmp_path: Path) -> None:
    stage = Stage()
    async with stage.service:
        await flying(stage)
        after = crashed(stage, tmp_path / "crashed")
    with capture_logs():
        async with deaf(after, "hold") as service:
            await eventually(lambda: service.mission("m1").state == "failed")
            assert "could not be brought up" in service.mission("m1").reason
            assert after.planners[0].state is MissionState.ENDED  # its process is gone
            started = await service.start("m1", "operator")
            assert started.state == "running"
            assert [planner.state for planner in after.planners] == ["ended", "running"]


@pytest.mark.asyncio
async def test_a_mission_that_does_not_resume_by_itself_stays_held(tmp_path: Path) -> None:
    stage = Stage()
    async with stage.service:
        await flying(stage)
        after = crashed(stage, tmp_path / "crashed")
    with capture_logs() as logs:
        async with deaf(after, "resume") as service:
            await eventually(lambda: any(line["event"] == "mission stays held" for line in logs))
            assert service.mission("m1").state == "held"


@pytest.mark.asyncio
async def test_sessions_that_were_ended_are_read_to_the_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("server.api.chronicle.PAGE", 2)
    stage = Stage()
    async with stage.service as service:
        for number in range(5):
            service.chronicle.session("ada", {"did": "logout", "session": f"s{number}"})
            service.chronicle.session("eve", {"did": "refused"})
        await service.chronicle.journal.commit(Entry(EntryKind.SERVER))
        assert await service.chronicle.ended_sessions() == ["s0", "s1", "s2", "s3", "s4"]


@pytest.mark.asyncio
async def test_a_start_reads_no_more_of_missions_long_over_than_that_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("server.api.revival.ENDED_KEPT", 2)
    stage = Stage()
    async with stage.service as service:
        for number in range(1, 6):
            await service.create(REQUEST, "operator")
            if number > 1:
                await service.stop(f"m{number}", "operator")
    read: list[str] = []
    again = Stage(folder=stage.folder)
    journal = again.service.chronicle.journal
    page = journal.page

    async def noted(mission: str, kind: EntryKind, after: int, limit: int) -> list[Sealed]:
        read.append(mission)
        return await page(mission, kind, after, limit)

    monkeypatch.setattr(journal, "page", noted)
    async with again.service as service:
        assert [mission.id for mission in service.missions()] == ["m1", "m4", "m5"]
    assert set(read) == {"m1", "m4", "m5"}
