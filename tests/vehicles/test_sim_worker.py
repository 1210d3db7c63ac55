"""The simulation as a real process over real Zenoh sockets, and the mission beside it."""

import asyncio
import json
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from time import monotonic

import pytest

from solver.observations import Link, LinkChange, Observation, RobotState
from solver.setpoints import Setpoint
from solver.zones import ZoneKind
from tests.patience import PATIENCE_S, patience_s
from tests.vehicles.buses import KEYS, LOOPBACK
from tests.vehicles.world.worlds import robot, world_setup, zone
from vehicles import messages as wire
from vehicles.link_monitor import LinkSettings
from vehicles.settings import SimulationSettings
from vehicles.sim_job import JobError, SimulationJob, dump_job, load_job
from vehicles.team_link import TeamLink
from vehicles.world.motion import Circle, Linear, Motion, RandomWalk, Replay, Waypoints
from vehicles.world.setup import WorldTarget
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

ROOT = Path(__file__).resolve().parents[2]
WORLD = world_setup(
    (robot(21, 0.0), robot(26, 5.0)),
    (WorldTarget(122, (3.0, 4.0)),),
    (zone("s1", ZoneKind.SENSING, (50.0, 50.0)),),
)
ROUTER = ZenohSettings(mode=ZenohMode.ROUTER, listen=(LOOPBACK,))

NOBODY = ZenohSettings(connect=("tcp/127.0.0.1:1",), open_timeout_s=0.1)


def job(endpoints: tuple[str, ...]) -> SimulationJob:
    return SimulationJob(
        world=WORLD,
        team="red",
        zenoh=ZenohSettings(connect=endpoints),
        simulation=SimulationSettings(seed=3, tick_s=0.05),
    )


def damaged(**changes: object) -> dict[str, object]:
    """Return the world of the job as JSON values, changed."""
    return {**json.loads(dump_job(job(("tcp/127.0.0.1:1",))))["world"], **changes}


@asynccontextmanager
async def worker(*arguments: str, **settings: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """Start the process; see to it that it is gone afterwards."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "vehicles.sim_worker",
        *arguments,
        cwd=ROOT,
        env={**os.environ, **settings},
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()


async def begin(process: asyncio.subprocess.Process, text: str) -> None:
    """Hand a process its job and wait until it is ready."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(text.encode() + b"\n")
    await process.stdin.drain()
    async with asyncio.timeout(PATIENCE_S):
        line = await process.stdout.readline()
    assert json.loads(line) == {"type": "ready", "robots": [21, 26]}


class Mission:
    """A planner that ticks in real time on a bus of its own."""

    def __init__(self, bus: ZenohBus, boot: str) -> None:
        self.link = TeamLink(bus, KEYS, (21, 26), boot, monotonic, LinkSettings())
        self.observed: list[Observation] = []
        self.ticks = 0

    async def tick(self) -> None:
        """Observe, and let both robots fly north."""
        self.observed.extend(self.link.drain(monotonic()))
        self.link.send_heartbeat("m1", self.ticks, 0.0, wire.PlannerState.RUNNING)
        self.link.send_setpoints(
            (Setpoint(robot_id, (0.0, 0.5), (0.0, 0.0), 1.5, 0.3) for robot_id in (21, 26)), "m1"
        )
        self.ticks += 1
        await asyncio.sleep(0.05)

    def speeds(self) -> dict[int, float]:
        """Return how fast each robot last said it was."""
        return {s.robot_id: s.velocity[1] for s in self.observed if isinstance(s, RobotState)}

    def links(self) -> dict[int, Link]:
        """Return how each robot was last reached."""
        return {c.robot_id: c.link for c in self.observed if isinstance(c, LinkChange)}

    async def until_speed(self, speed: float, limit_s: float = PATIENCE_S) -> None:
        """Tick until both robots say they have a speed."""
        async with asyncio.timeout(limit_s):
            while set(self.speeds().values()) != {speed} or len(self.speeds()) < 2:
                await self.tick()


@pytest.mark.process
@pytest.mark.asyncio
async def test_without_its_planner_every_vehicle_holds_within_a_second_and_resumes_with_it() -> (
    None
):
    async with ZenohBus(ROUTER, KEYS.delivery) as first:
        endpoints = first.endpoints
        async with worker("--until-eof") as process:
            await begin(process, dump_job(job(endpoints)))
            mission = Mission(first, "p1")
            async with mission.link:
                await mission.until_speed(0.5)
                assert set(mission.links().values()) == {Link.CONNECTED}
                # The planner stops; somebody else on the bus looks on.
                watcher = Mission(first, "watcher")
                async with watcher.link:
                    stopped = monotonic()
                    while set(watcher.speeds().values()) != {0.0} or len(watcher.speeds()) < 2:
                        watcher.observed.extend(watcher.link.drain(monotonic()))
                        await asyncio.sleep(0.02)
                        assert monotonic() - stopped < patience_s(), "held too late"
            await first.__aexit__(None, None, None)
            await asyncio.sleep(0.5)
            again = replace(ROUTER, listen=endpoints)
            async with ZenohBus(again, KEYS.delivery) as second:
                restarted = Mission(second, "p2")
                async with restarted.link:
                    await restarted.until_speed(0.5)
                    truth = restarted.link.truth()
                    assert truth is not None
                    assert truth.robots[0].position[1] > 0.0
                    assert process.stdin is not None
                    process.stdin.close()
                    async with asyncio.timeout(PATIENCE_S):
                        assert await process.wait() == 0
                        while set(restarted.links().values()) != {Link.LOST}:
                            await restarted.tick()


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_killed_vehicle_is_lost_at_once() -> None:
    async with ZenohBus(ROUTER, KEYS.delivery) as bus:
        mission = Mission(bus, "p1")
        async with mission.link, worker() as process:
            await begin(process, dump_job(job(bus.endpoints)))
            await mission.until_speed(0.5)
            process.kill()
            killed = monotonic()
            while set(mission.links().values()) != {Link.LOST}:
                await mission.tick()
                assert monotonic() - killed < 0.5 + patience_s()


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_second_world_with_the_same_robots_is_refused_loudly(tmp_path: Path) -> None:
    async with ZenohBus(ROUTER, KEYS.delivery) as bus:
        text = dump_job(job(bus.endpoints))
        path = tmp_path / "job.json"
        path.write_text(text)
        async with worker() as first:
            await begin(first, text)
            async with worker("--job", str(path)) as second, asyncio.timeout(PATIENCE_S):
                _, errors = await second.communicate()
                assert second.returncode == 1
            words = errors.decode()
            assert "robot 21 of team red is flown by another agent" in words
            assert "Traceback" not in words
            first.terminate()
            async with asyncio.timeout(PATIENCE_S):
                assert await first.wait() == 0, "a signal ends it in order"


@pytest.mark.process
@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("", 2, "sim: job"),
        ('{"team":"red"}', 2, "world"),
        (dump_job(replace(job(("tcp/127.0.0.1:1",)), team="a/b")), 2, "team name"),
        (dump_job(replace(job(("tcp/127.0.0.1:1",)), engine="magic")), 2, "magic"),
        (dump_job(replace(job(("tcp/127.0.0.1:1",)), zenoh=NOBODY)), 1, "nothing answers at"),
    ],
)
@pytest.mark.asyncio
async def test_what_cannot_work_ends_with_one_sentence(text: str, code: int, words: str) -> None:
    async with worker() as process:
        async with asyncio.timeout(PATIENCE_S):
            _, errors = await process.communicate(text.encode() + b"\n")
        assert process.returncode == code
        assert words in errors.decode()
        assert "Traceback" not in errors.decode()


def test_a_job_survives_json() -> None:
    text = dump_job(job(("tcp/127.0.0.1:7447",)))
    assert "\n" not in text
    again = load_job(text)
    assert again.world.robots == WORLD.robots
    assert again.zenoh == ZenohSettings(connect=("tcp/127.0.0.1:7447",))
    assert again.simulation.tick_s == 0.05
    assert dump_job(again) == text


def test_every_motion_survives_json() -> None:
    motions: tuple[Motion, ...] = (
        Linear(),
        RandomWalk(0.2),
        Waypoints(((1.0, 2.0),), 0.5),
        Circle((0.0, 1.0), -0.3),
        Replay((0.0, 1.0), ((0.0, 0.0), (1.0, 1.0))),
    )
    targets = tuple(
        WorldTarget(100 + index, (float(index), 0.0), motion=motion)
        for index, motion in enumerate(motions)
    )
    moving = replace(job(("tcp/127.0.0.1:1",)), world=replace(WORLD, targets=targets))
    assert load_job(dump_job(moving)).world == moving.world


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"world": None}, "world"),
        ({"world": damaged(robots=[{"id": 1}])}, r"world\.robots\.0\.position"),
        ({"world": damaged(noise="loud")}, r"world\.noise"),
        ({"world": damaged(attack_period_s=-1.0)}, "attack_period_s: -1.0"),
        ({"world": damaged(recover_density=float("nan"))}, "recover_density"),
        ({"zenoh": {"mode": "client"}}, "zenoh.*needs an endpoint"),
        ({"simulation": {"seed": "x"}}, r"simulation\.seed"),
    ],
)
def test_a_damaged_job_is_refused_with_the_field(change: dict[str, object], words: str) -> None:
    text = json.dumps({**json.loads(dump_job(job(("tcp/127.0.0.1:1",)))), **change})
    with pytest.raises(JobError, match=words):
        load_job(text)


@pytest.mark.process
@pytest.mark.asyncio
async def test_programs_get_an_object_per_line_of_its_log() -> None:
    async with (
        ZenohBus(ROUTER, KEYS.delivery) as bus,
        worker("--until-eof", FALCONER_LOG_FORMAT="json") as process,
    ):
        await begin(process, dump_job(job(bus.endpoints)))
        mission = Mission(bus, "p1")
        async with mission.link:
            await mission.until_speed(0.5)
        assert process.stdin is not None
        process.stdin.close()
        async with asyncio.timeout(PATIENCE_S):
            _, log = await process.communicate()
    lines = [json.loads(line) for line in log.splitlines()]
    assert "robot 21: flying: following setpoints" in [line["event"] for line in lines]
    assert all(line["level"] for line in lines)
