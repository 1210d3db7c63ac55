"""The mission's real processes: planner and simulated world over Zenoh, in real time."""

import asyncio
import math
import os
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from server.api.library import ScenarioLibrary, define_live
from server.api.service import MissionService
from server.live.channel import RequestRefused
from server.live.host import ProcessHost
from server.live.world import WorldHost
from server.scenarios import library
from server.settings import Settings
from tests.server.waiting import eventually

pytestmark = [pytest.mark.process, pytest.mark.timeout(120)]

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
    service = MissionService(ScenarioLibrary(SETTINGS), hosts.planner, hosts.world)
    scenario = library.named("hardware")
    async with service:
        service.add(
            define_live(scenario.mission_setup("sqp"), scenario.world_setup(), llm, SETTINGS)
        )
        await service.start("m1", "test")
        await eventually(lambda: (service.snapshot("m1") or {}).get("truth") is not None)
        yield service, hosts


def snapshot(service: MissionService) -> dict[str, Any]:
    found = service.snapshot("m1")
    assert found is not None
    return found


def places(service: MissionService) -> list[Any]:
    return [robot["position"] for robot in snapshot(service)["truth"]["robots"]]


@pytest.mark.asyncio
async def test_a_mission_flies_answers_a_comment_and_leaves_no_process() -> None:
    async with flying() as (service, hosts):
        pids = [hosts.planners[0].pid, hosts.worlds[0].pid]
        before = places(service)
        comment = await service.comment("m1", FOCUS, "operator")
        answered = {"applied", "partly_applied", "noted"}
        await eventually(
            lambda: service.comment_by_id("m1", comment.id).status in answered, within_s=20.0
        )
        await eventually(lambda: places(service) != before)
        held = await service.hold("m1", "operator")
        assert held.state == "held"
        result = await service.result("m1")
        assert result["scenario"] == "hardware"
        await service.stop("m1", "operator")
        assert (await service.result("m1"))["steps"] > 0
        assert [gone(pid) for pid in pids] == [True, True]


@pytest.mark.asyncio
async def test_a_killed_planner_leaves_the_vehicles_holding_and_can_come_back() -> None:
    async with flying("none") as (service, hosts):
        await eventually(lambda: snapshot(service)["time_s"] > 1.0)
        planner = hosts.planners[0].pid
        world = hosts.worlds[0].pid
        assert planner is not None
        before = places(service)
        os.kill(planner, signal.SIGKILL)
        await eventually(lambda: service.mission("m1").state == "failed")
        assert not gone(world)
        await asyncio.sleep(2.0)
        await service.start("m1", "operator")
        assert hosts.worlds[0].pid == world
        await eventually(lambda: 0.0 <= snapshot(service)["time_s"] < 1.0)
        # Set-points live half a second: the vehicles flew no longer than one second on.
        limit_m = 1.0 * math.hypot(*SPEED_M_S)
        for start, end in zip(before, places(service), strict=True):
            assert math.dist(start, end) < limit_m
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
