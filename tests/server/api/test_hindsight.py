"""Looking back at missions over REST and in the service."""

import shutil
from pathlib import Path

import pytest

from server.api.app import create_app
from server.api.errors import ServiceError
from server.api.models import MissionRequest
from server.course import MarkKind
from server.encoding import EventKind, Severity
from server.settings import Settings
from tests.server.api.serving import OpenDoor, Stage, client_of
from tests.server.api.test_missions import API, flying, refused, until
from tests.server.api.test_recordings import folder, serving
from tests.server.waiting import eventually

__all__ = ["folder"]

REQUEST = MissionRequest(scenario="scripted")


@pytest.mark.asyncio
async def test_a_live_mission_shows_any_second_it_has_flown() -> None:
    stage = Stage(period_s=1000.0)  # the test alone says what is flown
    async with client_of(stage.app(), stage) as client:
        await stage.service.create(REQUEST, "operator")
        await stage.service.start("m1", "operator")
        planner = stage.planners[0]
        for tick in range(1, 1201):
            planner.say(tick / 10)
        picture = (await client.get(f"{API}/missions/m1/snapshot?at_s=60.4")).json()
        assert picture["time_s"] == pytest.approx(60.1)
        assert picture["mission"] == "m1"
        newest = (await client.get(f"{API}/missions/m1/snapshot")).json()
        assert newest["time_s"] == 120.0
        too_early = await client.get(f"{API}/missions/m1/snapshot?at_s=0")
        assert "from 0 s" in refused(too_early, 409, "not_kept")["message"]
        for wrong in ("-1", "nan", "inf", "soon"):
            answer = await client.get(f"{API}/missions/m1/snapshot?at_s={wrong}")
            refused(answer, 422, "invalid_request")
        refused(await client.get(f"{API}/missions/m9/snapshot?at_s=1"), 404, "mission_unknown")


@pytest.mark.asyncio
async def test_pictures_of_one_flying_mission_are_kept() -> None:
    stage = Stage()
    async with stage.service as service:
        for mission in ("m1", "m2"):
            await service.create(REQUEST, "operator")
            await service.start(mission, "operator")
            await eventually(lambda m=mission: service.snapshot(m) is not None)  # type: ignore[misc]
            await service.stop(mission, "operator")
        first, second = service.records()
        assert first.past.from_s is None
        assert second.past.from_s is not None
        assert await service.hindsight.last("m1") is not None
        with pytest.raises(ServiceError, match="nothing is kept"):
            await service.hindsight.picture("m1", 5.0)


@pytest.mark.asyncio
async def test_the_course_of_a_live_mission_grows() -> None:
    stage = Stage(period_s=1000.0)
    async with stage.service as service:
        await service.create(REQUEST, "operator")
        await service.start("m1", "operator")
        planner = stage.planners[0]
        course = await service.hindsight.course("m1")
        for tick in range(50):
            planner.say(tick / 10)
        planner.event(EventKind.ATTACK, Severity.WARNING, "Robot 3 was blinded.", robot=3)
        assert [point.time_s for point in course.points] == [0.0, 1.0, 2.0, 3.0, 4.0]
        assert [mark.kind for mark in course.marks] == [MarkKind.FAILURE]


@pytest.mark.asyncio
async def test_the_course_outlasts_the_server() -> None:
    stage = Stage(period_s=1000.0)
    async with stage.service as service:
        await service.create(REQUEST, "operator")
        await service.start("m1", "operator")
        for tick in range(50):
            stage.planners[0].say(tick / 10)
        stage.planners[0].event(EventKind.HOLD, Severity.WARNING, "All robots hold.")
        await service.stop("m1", "operator")
    again = Stage(folder=stage.folder)
    async with again.service as service:
        course = await service.hindsight.course("m1")
        assert [point.time_s for point in course.points] == [0.0, 1.0, 2.0, 3.0, 4.0]
        assert [mark.kind for mark in course.marks] == [MarkKind.HOLD]
        assert await service.hindsight.course("m1") is course
        assert await service.hindsight.last("m1") is None
        assert service.hindsight.kept_from_s("m1") is None
        assert "was not recorded" in service.hindsight.absence("m1")


@pytest.mark.asyncio
async def test_an_ended_mission_without_pictures_says_why() -> None:
    stage = Stage(period_s=1000.0)
    async with stage.service as service:
        for mission in ("m1", "m2"):
            await service.create(REQUEST, "operator")
            assert service.hindsight.absence(mission) == f"Mission {mission} has not flown yet."
        await service.stop("m2", "operator")
        await service.start("m1", "operator")
        stage.planners[0].say(1.0)
        assert service.hindsight.absence("m1") == ""
        await service.stop("m1", "operator")
        assert service.hindsight.absence("m1") == ""
    again = Stage(folder=stage.folder)
    async with client_of(again.app(), again) as client:
        answer = refused(await client.get(f"{API}/missions/m1/snapshot"), 409, "no_snapshot")
        assert "it flew before this server was started, and was not recorded" in answer["message"]
        never = refused(await client.get(f"{API}/missions/m2/snapshot"), 409, "no_snapshot")
        assert never["message"] == "Mission m2 never flew."


@pytest.mark.asyncio
async def test_a_replay_has_its_recordings_course_and_pictures(folder: Path) -> None:
    async with serving(folder) as client:
        mission = (await client.post(f"{API}/recordings/flight.mcap/replay")).json()["id"]
        again = (await client.post(f"{API}/recordings/flight.mcap/replay")).json()["id"]
        assert again == mission, "one that is shown already is not opened twice"
        await client.post(f"{API}/missions/{mission}/pause")
        picture = await until(
            client, f"/missions/{mission}/snapshot?at_s=7.3", lambda s: "tick" in s
        )
        assert picture["time_s"] == 7.0
        assert picture["mission"] == mission


@pytest.mark.asyncio
async def test_replays_do_not_keep_a_mission_from_flying_and_are_few(folder: Path) -> None:
    for number in range(4):
        shutil.copy(folder / "flight.mcap", folder / f"copy{number}.mcap")
    try:
        async with serving(folder) as client:
            for number in range(4):
                answer = await client.post(f"{API}/recordings/copy{number}.mcap/replay")
                assert answer.status_code == 201
            answer = await client.post(f"{API}/recordings/flight.mcap/replay")
            refused(answer, 409, "too_many_replays")
            flown = await flying(client, scenario="demo", llm="none")
            live = (await client.get("http://127.0.0.1:8000/readyz")).json()["live_mission"]
            assert live == flown
    finally:
        for number in range(4):
            (folder / f"copy{number}.mcap").unlink()


@pytest.mark.asyncio
async def test_a_recorded_mission_shows_its_end_after_a_restart(folder: Path) -> None:
    """The journal names the file; the picture is the last one in it."""
    stage = Stage()
    app = create_app(Settings(), stage.service, door=OpenDoor())
    async with client_of(app, stage) as client:
        await stage.service.create(REQUEST, "operator")
        (record,) = stage.service.records()
        record.recording = folder / "flight.mcap"
        snapshot = (await client.get(f"{API}/missions/m1/snapshot")).json()
        assert snapshot["time_s"] == 19.5
        assert snapshot["mission"] == "m1"
        assert stage.service.hindsight.kept_from_s("m1") == 0.0


@pytest.mark.asyncio
async def test_a_recording_that_is_gone_meanwhile_is_told_of(folder: Path, tmp_path: Path) -> None:
    stage = Stage()
    async with client_of(stage.app(), stage) as client:
        await stage.service.create(REQUEST, "operator")
        (record,) = stage.service.records()
        record.recording = Path(shutil.copy(folder / "flight.mcap", tmp_path / "gone.mcap"))
        assert (await client.get(f"{API}/missions/m1/snapshot?at_s=7")).status_code == 200
        record.recording.unlink()
        answer = await client.get(f"{API}/missions/m1/snapshot?at_s=8")
        assert "gone.mcap cannot be read" in refused(answer, 409, "not_kept")["message"]
