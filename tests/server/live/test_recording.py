"""A live mission on real processes, recorded: its file proves itself, also when it was killed."""

import os
import signal
from contextlib import suppress
from pathlib import Path

import pytest

from server.api.definitions import define_live
from server.api.library import ScenarioLibrary
from server.journal.database import DatabaseJournal
from server.journal.store import Store
from server.live.host import ProcessHost
from server.live.world import WorldHost
from server.mission.tape import Committed
from server.recording.errors import RecordingError
from server.recording.reader import open_recording
from server.recording.verification import verify_recording
from server.scenarios import library
from server.settings import Settings
from tests.server.api.serving import StagedService
from tests.server.waiting import eventually

pytestmark = [pytest.mark.process]

ANSWERED = frozenset({"applied", "partly_applied", "noted"})
FOCUS = "The drone 21 should focus on tracking target 122"


def written(path: Path) -> bool:
    """Whether the answer to the comment has reached the disk."""
    with suppress(RecordingError):  # nothing has yet
        said = [c for picture in open_recording(path).snapshots() for c in picture["comments"]]
        return any(comment["status"] in ANSWERED for comment in said)
    return False


@pytest.mark.asyncio
async def test_a_live_mission_is_recorded_and_gives_its_setpoints_again(tmp_path: Path) -> None:
    settings = Settings(engine="sqp", recordings=tmp_path)
    planners: list[ProcessHost] = []

    def planner(definition: object) -> ProcessHost:
        planners.append(ProcessHost())
        return planners[-1]

    journal = DatabaseJournal(Store(f"sqlite:///{tmp_path}/journal.db"))
    service = StagedService(ScenarioLibrary(settings), planner, lambda _: WorldHost(), journal)
    scenario = library.named("hardware")
    setup, world = scenario.mission_setup("sqp"), scenario.world_setup()
    async with service:
        await service.add(define_live(setup, world, "mock", settings), "test")
        await service.start("m1", "test")
        await service.comment("m1", FOCUS, "operator")
        await eventually(lambda: any(c.status in ANSWERED for c in service.comments("m1")))
        first = service.recording("m1")
        assert planners[0].pid is not None
        await eventually(lambda: written(first))
        os.kill(planners[0].pid, signal.SIGKILL)
        await eventually(lambda: service.mission("m1").state == "failed")
        broken_s = (service.snapshot("m1") or {})["time_s"]
        await service.start("m1", "test")
        await service.resume("m1", "test")
        second = service.recording("m1")
        await eventually(lambda: (service.snapshot("m1") or {})["time_s"] > broken_s + 1.0)
        result = (await service.stop("m1", "test"), await service.result("m1"))[1]

    assert first != second
    cut, whole = open_recording(first), open_recording(second)
    assert not cut.complete
    assert whole.complete
    for recording in (cut, whole):
        found = verify_recording(recording, lambda seconds: None)
        assert found.passed, found.differences
    assert FOCUS in {c["text"] for s in cut.snapshots() for c in s["comments"]}
    ticks = sum(isinstance(entry, Committed) for entry in whole.entries())
    assert 0 < ticks < result["steps"]  # those before the crash are counted too
    (ended,) = [event for event in whole.events() if event["kind"] == "ended"]
    assert ended["data"]["result"]["steps"] == result["steps"]
    truth = whole.truth_at(whole.duration_s)
    assert truth is not None
    assert {robot.id for robot in truth.robots} == set(setup.robot_ids)
