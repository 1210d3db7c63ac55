"""The mission's real processes: planner and simulated world over Zenoh, in real time."""

import asyncio
import contextlib
import gc
import math
import os
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from server.api.definitions import define_live
from server.api.library import ScenarioLibrary
from server.api.service import MissionService
from server.journal.database import DatabaseJournal
from server.journal.store import Store
from server.live.channel import RequestRefused
from server.live.host import ProcessHost
from server.live.job import PlannerJob, dump_job
from server.live.worker import warm_planner
from server.live.world import WorldHost
from server.mission.core import MissionCore
from server.scenarios import library
from server.settings import Settings
from tests.patience import busy
from tests.server.api.serving import StagedService
from tests.server.waiting import eventually
from vehicles.keys import TeamKeys
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

pytestmark = [pytest.mark.process]

SETTINGS = Settings(engine="sqp")  # needs no compilation
SPEED_M_S = (0.5, 0.5)
"""Box of the robots in the hardware case."""

FOCUS = "The drone 21 should focus on tracking target 122"


def gone(pid: int | None) -> bool:
    """Whether a process has ended; a zombie has."""
    if pid is None:
        return True
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8") as stat:  # noqa: PTH123
            return stat.read().split(")")[1].split()[0] == "Z"
    except FileNotFoundError:
        return True


class Hosts:
    """Makes real processes and remembers them."""

    def __init__(self) -> None:
        self.planners: list[ProcessHost] = []
        self.worlds: list[WorldHost] = []

    def planner(self, definition: object) -> ProcessHost:
        self.planners.append(ProcessHost())
        return self.planners[-1]

    def world(self, definition: object) -> WorldHost:
        self.worlds.append(WorldHost())
        return self.worlds[-1]


@asynccontextmanager
async def flying(llm: str = "mock") -> AsyncIterator[tuple[MissionService, Hosts]]:
    """The hardware case as mission m1, live."""
    hosts = Hosts()
    scenario = library.named("hardware")
    with TemporaryDirectory() as folder:
        journal = DatabaseJournal(Store(f"sqlite:///{folder}/journal.db"))
        service = StagedService(ScenarioLibrary(SETTINGS), hosts.planner, hosts.world, journal)
        async with service:
            setup = scenario.mission_setup("sqp")
            definition = define_live(setup, scenario.world_setup(), llm, SETTINGS)
            await service.add(definition, "test")
            await service.start("m1", "test")
            await eventually(lambda: (service.snapshot("m1") or {}).get("truth") is not None)
            yield service, hosts


def snapshot(service: MissionService) -> dict[str, Any]:
    found = service.snapshot("m1")
    assert found is not None
    return found


def places(service: MissionService) -> list[Any]:
    return [robot["position"] for robot in snapshot(service)["truth"]["robots"]]


def test_what_is_loaded_before_a_flight_is_kept_from_the_collector() -> None:
    try:
        warm_planner(None, MissionCore(library.named("hardware").mission_setup()))
        assert gc.get_freeze_count() > 10 * len(gc.get_objects())
    finally:
        gc.unfreeze()


@pytest.mark.asyncio
async def test_a_mission_flies_answers_a_comment_and_leaves_no_process() -> None:
    async with flying() as (service, hosts):
        pids = [hosts.planners[0].pid, hosts.worlds[0].pid]
        before = places(service)
        comment = await service.comment("m1", FOCUS, "operator")
        answered = {"applied", "partly_applied", "noted"}
        await eventually(lambda: service.comment_by_id("m1", comment.id).status in answered)
        await eventually(lambda: places(service) != before)
        held = await service.hold("m1", "operator")
        assert held.state == "held"
        result = await service.result("m1")
        assert result["scenario"] == "hardware"
        await service.stop("m1", "operator")
        assert (await service.result("m1"))["steps"] > 0
        assert [gone(pid) for pid in pids] == [True, True]


@pytest.mark.asyncio
async def test_a_killed_planner_leaves_the_vehicles_holding_and_comes_back_where_it_was() -> None:
    async with flying("none") as (service, hosts):
        await eventually(lambda: snapshot(service)["time_s"] > 1.0)
        comment = await service.comment("m1", FOCUS, "alice")
        await service.direct("m1", "weights", {"weights": [20.0, 0.05, 50.0, 50.0]}, "bob")
        await eventually(lambda: snapshot(service)["directives"]["weights"]["tracking"] == 20.0)
        known, counted = snapshot(service), await service.result("m1")
        planner = hosts.planners[0].pid
        world = hosts.worlds[0].pid
        assert planner is not None
        before = places(service)
        os.kill(planner, signal.SIGKILL)
        await eventually(lambda: service.mission("m1").state == "failed")
        assert not gone(world)
        await asyncio.sleep(3.0)
        again = await service.start("m1", "operator")
        assert again.state == "held"
        assert hosts.worlds[0].pid == world
        started_s = time.monotonic()
        await eventually(lambda: snapshot(service)["stamp_s"] > started_s)
        # Set-points live half a second, and a busy world may take its time to brake.
        limit_m = 2.0 * math.hypot(*SPEED_M_S)
        for start, end in zip(before, places(service), strict=True):
            assert math.dist(start, end) < limit_m
        found, result = snapshot(service), await service.result("m1")
        assert found["state"] == "held"
        assert found["time_s"] > known["time_s"] - 1.0 * busy()
        for name in ("assignment", "weights", "capacities"):
            assert found["directives"][name] == known["directives"][name]
        assert comment.id in {said["id"] for said in found["comments"]}
        assert {zone["id"] for zone in known["zones"]} <= {zone["id"] for zone in found["zones"]}
        # A checkpoint is a second old at the most, but for a machine that is very busy.
        assert result["steps"] > counted["steps"] - 15 * busy()
        assert result["accumulated_trace"] > 0.5 * counted["accumulated_trace"]
        assert result["trajectory_length_m"] > 0.5 * counted["trajectory_length_m"]
        assert result["gate"]["since_s"] > 0.0
        await service.resume("m1", "operator")
        await eventually(
            lambda: all(robot["link"] == "connected" for robot in snapshot(service)["robots"])
        )
        assert service.mission("m1").state == "running"


@pytest.mark.asyncio
async def test_a_planner_that_cannot_start_says_why() -> None:
    child = ProcessHost()
    running = asyncio.create_task(child.run(lambda frame: None))
    with pytest.raises(RequestRefused, match="setup"):
        await child.request("prepare", {"mission": "m1", "job": {"llm": "none"}}, timeout_s=60.0)
    with pytest.raises(RequestRefused, match="has not started"):
        await child.request("hold")
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert gone(child.pid)


@pytest.mark.asyncio
async def test_a_planner_on_a_router_is_started_again_as_its_client() -> None:
    setup = library.named("hardware").mission_setup("sqp")
    router = ZenohSettings(mode=ZenohMode.ROUTER, listen=("tcp/127.0.0.1:0",))
    async with ZenohBus(router, TeamKeys(setup.team).delivery) as bus:
        endpoint = bus.endpoints[0]
        client = ZenohSettings(connect=(endpoint,), open_timeout_s=60.0)
        job = dump_job(PlannerJob(setup, "none", client))
        for before in (None, endpoint):
            child = ProcessHost()
            running = asyncio.create_task(child.run(lambda frame: None))
            params = {"mission": "m1", "job": job, "endpoint": before}
            answer = await child.request("prepare", params, timeout_s=90.0)
            assert answer["endpoint"] == endpoint
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)


def model_worker(planner: int | None) -> int | None:
    """Return the process of the embedded model that a planner has started."""
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
            if parent == planner and b"llm.local.worker" in (folder / "cmdline").read_bytes():
                return int(folder.name)
    return None


@pytest.mark.asyncio
async def test_an_embedded_model_that_dies_is_started_again_and_ends_with_the_mission() -> None:
    async with flying("local") as (service, hosts):
        planner = hosts.planners[0].pid
        await eventually(lambda: model_worker(planner) is not None)
        worker, tick = model_worker(planner), snapshot(service)["tick"]
        assert worker is not None
        os.kill(worker, signal.SIGKILL)
        # The call in flight fails; the next one starts it again.
        await eventually(lambda: model_worker(planner) not in (None, worker), within_s=150.0)
        await eventually(lambda: snapshot(service)["tick"] > tick)
        assert snapshot(service)["state"] == "running"
        again = model_worker(planner)
        await service.stop("m1", "operator")
    await eventually(lambda: gone(again))  # a planner that had to be killed leaves it to end itself
