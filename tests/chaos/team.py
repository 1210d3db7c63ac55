"""Everything that runs, as processes of their own, with the watch and the clients around it."""

import asyncio
import os
import random
import shutil
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from time import monotonic
from uuid import uuid4

import httpx
import yaml

from benchmarks.fleet import FALCONER, ROOT, Autopilot, Fleet, Running, free_port, world
from server.scenarios import library
from server.scenarios.schema import Scenario
from solver.engines.fast.compiled import compiled
from tests.chaos.clients import Browser, Commenter, Steerer, Visitor, api
from tests.chaos.disk import SmallDisk, small_disk
from tests.chaos.ear import Ear
from tests.chaos.journals import Database, Lite, served
from tests.chaos.processes import planner_of
from tests.chaos.watch import Findings, Watch
from tests.faults.clock import set_clock
from tests.faults.links import BusLink, MavlinkLink, until
from tests.patience import PATIENCE_S, busy
from vehicles import messages as wire
from vehicles.keys import Topic
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

FILE = Path(__file__).parent / "chaos.yaml"
FAKE_CLOCK = ROOT / "tests" / "faults" / "fakeclock"
ARDUPILOT, PX4, APART = 21, 22, 26
OUTSIDE = (ARDUPILOT, PX4, APART)
"""Robots that fly outside of the simulated world's process, each in one of its own."""

ROBOTS = (21, 22, 23, 24, 25, 26)
OPERATOR, VIEWER, ADMIN = (f"{role}-of-the-chaos" for role in ("operator", "viewer", "admin"))
START_S = 120.0
FLYING_S = 60.0
PATIENT_S = 6.0
"""A robot that stands for so long while the mission runs has been stopped by its autopilot."""

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
LOSS = ("--setpoint-loss", "0.5")


@dataclass
class Team:
    """What runs, and how it is started again."""

    scenario: Scenario
    fleet: Fleet
    folder: Path
    disk: SmallDisk
    database: Database
    environment: dict[str, str]
    ports: dict[str, int]
    watch: Watch
    findings: Findings
    session: ZenohBus
    trunk: BusLink
    """Between the server and the bus."""

    door: BusLink
    """Between the server and whoever judges what it says."""

    links: dict[int, MavlinkLink]
    autopilots: dict[int, Autopilot]
    commenter: Commenter
    steerer: Steerer
    ear: Ear
    visitor: Visitor | None = None
    running: dict[str, Running] = field(default_factory=dict)
    extra: dict[int, tuple[str, ...]] = field(default_factory=dict)
    """More options of vehicles."""

    _numbers: Iterator[int] = field(default_factory=count)

    @property
    def bus(self) -> str:
        """The router's endpoint."""
        return f"tcp/127.0.0.1:{self.ports['bus']}"

    @property
    def web(self) -> str:
        """The server's own address."""
        return f"http://127.0.0.1:{self.ports['web']}"

    @property
    def mock(self) -> str:
        """The language model's address."""
        return f"http://127.0.0.1:{self.ports['llm']}"

    @property
    def server(self) -> int:
        """Process id of the server."""
        return self.running["server"].process.pid

    @property
    def planner(self) -> int:
        """Process id of the planner. Raises AssertionError while there is none."""
        found = planner_of(self.server)
        assert found is not None, "there is no planner"
        return found

    @property
    def clock_file(self) -> Path:
        """Holds by how much the server's wall clock is off, in seconds."""
        return Path(self.environment["WALL_CLOCK_OFFSET_FILE"])

    def pid(self, name: str) -> int:
        """Return the process id of one of those that run."""
        return self.running[name].process.pid

    # ------------------------------------------------------------------ starting

    async def start_router(self) -> None:
        """Start the router."""
        command = (*FALCONER, "router", str(FILE), "--listen", self.bus)
        self.running["router"] = await self.fleet.start("router", command, "routing")

    async def start_llm(self) -> None:
        """Start the language model."""
        command = (*FALCONER, "mock-llm", "--port", str(self.ports["llm"]))
        self.running["llm"] = await self.fleet.start("llm", command)
        async with httpx.AsyncClient(trust_env=False) as http:
            until_s = monotonic() + START_S
            while monotonic() < until_s:
                with suppress(httpx.HTTPError):
                    if (await http.get(f"{self.mock}/v1/models")).is_success:
                        return
                await asyncio.sleep(0.1)
        raise AssertionError(f"the language model did not start:\n{self.running['llm'].log}")

    async def start_server(self) -> None:
        """Start the server, which flies the scenario or brings its mission up again."""
        command = (
            *(*FALCONER, "serve", str(FILE), "--llm", f"{self.mock}/v1"),
            *("--port", str(self.ports["web"])),
            *("--zenoh-connect", f"tcp/127.0.0.1:{self.trunk.port}"),
        )
        self.running["server"] = await self.fleet.start(
            "server", self.disk.command(command), "Falconer on", self.environment
        )

    async def start_world(self) -> None:
        """Start the simulated world."""
        command = world(str(FILE), self.bus, OUTSIDE)
        self.running["world"] = await self.fleet.start("world", command)

    async def start_vehicle(self, robot: int) -> None:
        """Start what flies a robot, and wait until it speaks."""
        before = self.watch.states.get(robot)
        name = f"vehicle {robot}"
        self.running[name] = await self.launch_vehicle(robot)
        if before is not None:
            await until(
                lambda: self.watch.states[robot].boot != before.boot,
                START_S,
                f"robot {robot} speaks again",
            )

    async def launch_vehicle(self, robot: int) -> Running:
        """Start a process that flies a robot: the bridge of an autopilot, or a simulated one."""
        extra = self.extra.get(robot, ())
        if robot == APART:
            command: tuple[str, ...] = (
                *(*FALCONER, "vehicle", "sim", str(self._where_it_is(robot))),
                *("--robot", str(robot)),
                *("--zenoh-connect", self.bus, *extra),
            )
        else:
            port = self.links[robot].port
            command = self.autopilots[robot].bridge(self.bus, str(FILE), *extra, port=port)
        return await self.fleet.start(f"vehicle {robot}", command)

    def _where_it_is(self, robot: int) -> Path:
        """Write a scenario where a robot stands where it was: it has no body to be found by."""
        state = self.watch.states.get(robot)
        if state is None:
            return FILE
        values = yaml.safe_load(FILE.read_text("utf-8"))
        for each in values["robots"]:
            if each["id"] == robot:
                each["position"] = list(state.position)
        file = self.folder / "chaos.yaml"
        file.write_text(yaml.safe_dump(values), "utf-8")
        return file

    async def start_autopilot(self, robot: int) -> None:
        """Start a simulated autopilot."""
        name = f"autopilot {robot}"
        command = self.autopilots[robot].command()
        self.running[name] = await self.fleet.start(name, command, "at udpin")

    # ------------------------------------------------------------------ asking and waiting

    async def behave(self, mode: str, delay_s: float = 5.0) -> None:
        """Let the language model behave so from now on."""
        async with httpx.AsyncClient(trust_env=False) as http:
            body = {"mode": mode, "delay_s": delay_s}
            (await http.put(f"{self.mock}/mock/behaviour", json=body)).raise_for_status()

    async def order(self, what: str) -> int:
        """Ask something of the mission; return the status, 0 without an answer."""
        with suppress(httpx.HTTPError):
            async with api(self.web, bearer(OPERATOR)) as http:
                return (await http.post(f"/missions/m1/{what}", timeout=START_S)).status_code
        return 0

    async def until_flying(self) -> float:
        """Bring the mission to its feet; return how long it took until all robots fly."""
        began_s = monotonic()
        patient_s = began_s + PATIENT_S
        until_s = began_s + FLYING_S * (1.0 + busy())
        while monotonic() < until_s:
            match self.ear.state:
                case "failed":
                    await self.order("start")
                case "held" | "paused":
                    await self.order("resume")
                case "running" if all(map(self.watch.flies, ROBOTS)):
                    self.watch.away.clear()
                    return monotonic() - began_s
                case "running" if monotonic() > patient_s:
                    patient_s = monotonic() + PATIENT_S
                    self._free()
            await asyncio.sleep(0.1)
        raise AssertionError(f"not all fly again:\n{self.told()}")

    def _free(self) -> None:
        """Tell autopilots that a failsafe stopped to follow again, as their operator would."""
        for robot in (ARDUPILOT, PX4):
            if not self.watch.flies(robot):
                message = wire.Command(
                    v=1,
                    boot="operator",
                    seq=next(self._numbers),
                    stamp_s=monotonic(),
                    robot_id=robot,
                    command=wire.Order.RESUME,
                    command_id=uuid4().hex,
                    author="operator of the chaos",
                )
                key = self.watch.keys.robot(robot, Topic.COMMAND)
                self.session.publish(key, wire.encode(message))

    async def until_gone(self, condition: Callable[[], object], what: str) -> None:
        """Wait for something that may take a while on a busy machine."""
        await until(condition, PATIENCE_S, what)

    def told(self) -> str:
        """Return what is known, for people who look for the cause."""
        lines = [f"mission {self.ear.state!r}, alarms and events:"]
        lines += [f"  {one.kind} {one.text}" for one in self.ear.told[-12:]]
        for robot in ROBOTS:
            state = self.watch.states.get(robot)
            age = "never heard" if state is None else f"{monotonic() - state.stamp_s:.1f} s ago"
            lines.append(f"robot {robot}: {state and state.mode}, {age}")
        for name, one in self.running.items():
            last = "\n    ".join(list(one.lines)[-4:])
            lines.append(f"{name}: {'runs' if one.alive else 'has ended'}\n    {last}")
        return "\n".join(lines)


def bearer(token: str) -> dict[str, str]:
    """Return the header by which a program says who it is."""
    return {"authorization": f"Bearer {token}"}


@asynccontextmanager
async def team(folder: Path, seed: int, database: str) -> AsyncIterator[Team]:
    """Start everything; yield it once all robots fly.

    Args:
        folder: Empty; for the journal and small files.
        seed: Of the clients' dice.
        database: `sqlite` or `postgresql`.
    """
    # Whoever needs the kernels would compile them for himself.
    await asyncio.to_thread(compiled)
    async with AsyncExitStack() as stack:
        made = await _made(stack, folder, seed, database)
        await asyncio.gather(
            made.start_llm(),
            made.start_world(),
            *(made.start_autopilot(robot) for robot in (ARDUPILOT, PX4)),
            *(made.start_vehicle(robot) for robot in OUTSIDE),
        )
        await made.start_server()
        watching = [made.watch.listen(), made.ear.listen(), made.ear.poll()]
        tasks = [asyncio.create_task(one) for one in watching]
        stack.push_async_callback(_cancel, tasks)
        await made.until_flying()
        tasks += [asyncio.create_task(one.run()) for one in (made.commenter, made.steerer)]
        executable = next((path for name in BROWSERS if (path := shutil.which(name))), None)
        made.visitor = await stack.enter_async_context(Browser(made.web, VIEWER, executable))
        yield made
        for task in tasks:
            if task.done():
                task.result()  # whoever watches must not have ended


async def _made(stack: AsyncExitStack, folder: Path, seed: int, database: str) -> Team:
    scenario = library.load(str(FILE))
    fleet = await stack.enter_async_context(Fleet())
    ports = {name: free_port() for name in ("bus", "web", "llm")}
    disk = await small_disk(fleet, folder / "disk")
    kept: Database = Lite(disk) if database == "sqlite" else await served()
    stack.push_async_callback(kept.close)
    clock = folder / "clock"
    set_clock(clock, 0.0)
    autopilots = {
        robot.id: Autopilot(
            robot.id,
            "px4" if robot.id == PX4 else "ardupilot",
            free_port(socket.SOCK_DGRAM),
            robot.id,
            robot.position,
            robot.altitude_m,
            LOSS if robot.id == ARDUPILOT else (),
        )
        for robot in scenario.robots
        if robot.id in (ARDUPILOT, PX4)
    }
    links = {
        i: await stack.enter_async_context(MavlinkLink(one.port, seed))
        for i, one in autopilots.items()
    }
    trunk = await stack.enter_async_context(BusLink(ports["bus"]))
    door = await stack.enter_async_context(BusLink(ports["web"]))
    findings = Findings()
    watch = Watch(scenario, findings, autopilots)
    bus = f"tcp/127.0.0.1:{ports['bus']}"
    command = (*FALCONER, "router", str(FILE), "--listen", bus)
    router = await fleet.start("router", command, "routing")
    session = await stack.enter_async_context(
        ZenohBus(ZenohSettings(connect=(bus,)), watch.keys.delivery)
    )
    for topic in (Topic.STATE, Topic.SETPOINT, Topic.EVENTS):
        await session.subscribe(watch.keys.robot(None, topic), watch.inbox)
    await session.subscribe(watch.keys.truth, watch.inbox)
    web = f"http://127.0.0.1:{ports['web']}"
    return Team(
        scenario, fleet, folder, disk, kept, _environment(kept, clock), ports, watch, findings,
        session, trunk, door, links, autopilots,
        Commenter(web, bearer(OPERATOR), findings, random.Random(seed)),
        Steerer(web, bearer(OPERATOR), findings, random.Random(seed + 1)),
        Ear(f"http://127.0.0.1:{door.port}", bearer(VIEWER), findings),
        running={"router": router},
    )  # fmt: skip


def _environment(database: Database, clock: Path) -> dict[str, str]:
    return {
        "PYTHONPATH": f"{FAKE_CLOCK}{os.pathsep}{ROOT}",
        "WALL_CLOCK_OFFSET_FILE": str(clock),
        "FALCONER_DATABASE_URL": database.address,
        "FALCONER_OPERATOR_TOKEN": OPERATOR,
        "FALCONER_VIEWER_TOKEN": VIEWER,
        "FALCONER_ADMIN_TOKEN": ADMIN,
        "FALCONER_REQUEST_RATE": "10",
        "FALCONER_SESSION_SECRET": "sessions-outlast-the-chaos-of-this-run",
    }


async def _cancel(tasks: list[asyncio.Task[None]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
