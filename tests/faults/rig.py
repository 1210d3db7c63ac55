"""A whole team as real processes: router, planner, simulated world, bridges, autopilots."""

import asyncio
import os
import signal
import socket
from collections.abc import AsyncIterator, Iterable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from math import hypot
from pathlib import Path
from time import monotonic
from typing import Any

from benchmarks.fleet import FALCONER, ROOT, Autopilot, Fleet, Running, free_port, world
from server.live.host import ProcessHost
from server.live.job import PlannerJob, dump_job
from server.live.outbox import Frame
from server.scenarios import library
from server.scenarios.schema import Scenario
from tests.faults.clock import set_clock
from tests.faults.links import BusLink, MavlinkLink, until
from tests.patience import PATIENCE_S, busy
from vehicles import messages as wire
from vehicles.inbox import Inbox
from vehicles.keys import TeamKeys, Topic
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

HERE = Path(__file__).parent
FILE = HERE / "faults.yaml"
NATIVE = 23
"""Flown by the simulated world itself."""

ARDUPILOT, PX4, SIGNED, SPARE = 21, 22, 24, 25
STARTED = (ARDUPILOT, PX4, SIGNED)
"""MAVLink vehicles that fly from the start; the spare one is started by the tests that need it."""

FLYING = (*STARTED, NATIVE)
MOVING_M_S, STILL_M_S = 0.2, 0.1
"""Robots follow their targets at some 0.4 m/s."""

LOSS = ("--setpoint-loss", "0.5")
"""What a careful owner sets his autopilot to; ArduPilot's own default is 3 s."""


def in_flight_s() -> float:
    """Return for how long after an order something sent before it may still arrive."""
    return 0.15 * busy()


@dataclass
class Witness:
    """What is said on the bus, as somebody hears it who takes no part."""

    keys: TeamKeys
    inbox: Inbox
    states: dict[int, wire.State] = field(default_factory=dict)
    heard_s: dict[int, float] = field(default_factory=dict)
    healths: dict[int, wire.Health] = field(default_factory=dict)
    events: list[tuple[float, wire.Event]] = field(default_factory=list)
    """When each happened, by its robot's clock (everybody's on one machine), and what."""

    died_s: list[float] = field(default_factory=list)
    """When links died: each may have taken along what was just on its way."""

    async def listen(self) -> None:
        """Listen for ever."""
        while True:
            for sample in self.inbox.drain():
                address = self.keys.parse(sample.key)
                if address is None or address.robot_id is None:
                    continue
                with suppress(wire.MessageError):
                    self._take(address.topic, sample.payload)
            await asyncio.sleep(0.01)

    def _take(self, topic: Topic, payload: bytes) -> None:
        now_s = monotonic()
        if topic is Topic.STATE:
            state = wire.decode(wire.State, payload)
            self.states[state.robot_id], self.heard_s[state.robot_id] = state, now_s
        elif topic is Topic.HEALTH:
            health = wire.decode(wire.Health, payload)
            self.healths[health.robot_id] = health
        elif topic is Topic.EVENTS:
            event = wire.decode(wire.Event, payload)
            self.events.append((event.stamp_s - event.age_s, event))

    def mode(self, robot_id: int) -> wire.Mode | None:
        """Return what a robot says it flies by, None when it has not been heard for a second."""
        if monotonic() - self.heard_s.get(robot_id, -1.0) > 1.0:
            return None
        return self.states[robot_id].mode

    def speed_m_s(self, robot_id: int) -> float:
        """Return how fast a robot last said it was."""
        return hypot(*self.states[robot_id].velocity)

    def notices(self, robot_id: int, code: str, since_s: float = 0.0) -> list[str]:
        """Return the words of a robot's notices of one kind."""
        return [
            event.event.text
            for at_s, event in self.events
            if event.robot_id == robot_id and at_s > since_s
            if isinstance(event.event, wire.NoticePart) and event.event.code == code
        ]

    def modes(self, robot_id: int, since_s: float) -> list[wire.ModePart]:
        """Return a robot's changes of mode since a moment."""
        return [
            event.event
            for at_s, event in self.events
            if event.robot_id == robot_id and at_s > since_s
            if isinstance(event.event, wire.ModePart)
        ]

    def check_once(self) -> None:
        """Fail when an event came twice, or a change of mode that no link took along did not."""
        told = [(event.boot, event.robot_id, event.seq) for _, event in self.events]
        assert len(told) == len(set(told)), "an event was told twice"
        last: dict[tuple[str, int], tuple[float, wire.Mode]] = {}
        for at_s, event in self.events:
            part, who = event.event, (event.boot, event.robot_id)
            if isinstance(part, wire.ModePart):
                before_s, mode = last.get(who, (at_s, part.previous))
                taken_along = any(before_s <= died_s <= at_s for died_s in self.died_s)
                assert mode is part.previous or taken_along, (who, part)
                last[who] = at_s, part.mode


class Planner:
    """The planner's process, as the web side runs it."""

    def __init__(self, scenario: Scenario, bus: str, environment: dict[str, str]) -> None:
        self.news: list[dict[str, Any]] = []
        self.snapshot: dict[str, Any] = {}
        self._job = PlannerJob(
            scenario.mission_setup(None), "none", ZenohSettings(connect=(bus,), open_timeout_s=60.0)
        )
        self._environment = {**os.environ, **environment}
        self._host: ProcessHost | None = None
        self._run: asyncio.Task[int] | None = None

    @property
    def pid(self) -> int:
        """The process's id."""
        assert self._host is not None
        assert self._host.pid is not None
        return self._host.pid

    @property
    def ticks(self) -> tuple[int, int]:
        """Ticks flown and missed so far."""
        optimizer = self.snapshot["loops"]["optimizer"]
        return optimizer["calls"], optimizer["missed"]

    async def start(self) -> None:
        """Start it and let it fly."""
        self._host = ProcessHost(environment=self._environment)
        self._run = asyncio.create_task(self._host.run(self._receive))
        params = {"job": dump_job(self._job), "mission": "m1"}
        await self._host.request("prepare", params, timeout_s=PATIENCE_S)
        await self._host.request("start", timeout_s=PATIENCE_S)

    async def end(self, number: signal.Signals = signal.SIGTERM) -> None:
        """End it by a signal and wait until it is gone."""
        assert self._run is not None
        if not self._run.done():
            os.kill(self.pid, signal.SIGCONT)
            os.kill(self.pid, number)
        await asyncio.gather(self._run, return_exceptions=True)

    def told(self, words: str) -> list[str]:
        """Return the news in which these words stand."""
        return [one["text"] for one in self.news if words in one.get("text", "")]

    def _receive(self, frame: Frame) -> None:
        if frame.is_snapshot:
            self.snapshot = frame.data
        else:
            self.news.append(frame.data)


@dataclass
class Team:
    """Everything that runs, and what can be done to it."""

    scenario: Scenario
    fleet: Fleet
    folder: Path
    bus_port: int
    environment: dict[str, str]
    witness: Witness
    session: ZenohBus
    planner: Planner
    router: Running
    links: dict[int, MavlinkLink]
    bus_links: tuple[BusLink, BusLink]
    autopilots: dict[int, Autopilot]
    bridges: dict[int, Running] = field(default_factory=dict)

    @property
    def bus(self) -> str:
        """The router's endpoint."""
        return f"tcp/127.0.0.1:{self.bus_port}"

    @property
    def clock_file(self) -> Path:
        """Holds by how much the processes' wall clocks are off, in seconds."""
        return Path(self.environment["WALL_CLOCK_OFFSET_FILE"])

    async def start_router(self) -> None:
        """Start the router."""
        self.router = await self.fleet.start("router", _router(self.bus), "routing")

    def kill_router(self) -> None:
        """Kill the router, with all that it has not passed on."""
        self.witness.died_s.append(monotonic())
        self.router.send(signal.SIGKILL)

    async def cut(self, link: BusLink) -> None:
        """Cut a link, with all that is on its way."""
        self.witness.died_s.append(monotonic())
        await link.cut()

    async def start_bridge(self, robot_id: int) -> None:
        """Start the bridge of a MAVLink vehicle."""
        autopilot = self.autopilots[robot_id]
        extra = ("--signing-key", str(self.folder / "key")) if robot_id == SIGNED else ()
        buses = self.bus
        if robot_id == PX4:
            buses = ",".join(f"tcp/127.0.0.1:{link.port}" for link in self.bus_links)
        command = autopilot.bridge(buses, str(FILE), *extra, port=self.links[robot_id].port)
        name = f"bridge {robot_id}"
        self.bridges[robot_id] = await self.fleet.start(
            name, command, "announced", self.environment
        )

    async def until_flying(
        self, robot_ids: Iterable[int] = FLYING, patience_s: float = PATIENCE_S
    ) -> float:
        """Wait until robots follow the planner and move; return how long it took."""
        wanted = tuple(robot_ids)
        try:
            return sum([await until(partial(self.flies, i), patience_s) for i in wanted])
        except AssertionError:
            raise AssertionError(self.told_of(wanted)) from None

    async def until_held(self, robot_ids: Iterable[int], patience_s: float) -> float:
        """Wait until MAVLink vehicles stand still; return how long it took."""
        wanted = tuple(robot_ids)
        return await until(
            lambda: all(self.links[i].heard.speed_m_s < STILL_M_S for i in wanted),
            patience_s,
            f"holding: {self.told_of(wanted)}",
        )

    async def still_flying(self, robot_ids: Iterable[int] = FLYING) -> None:
        """Wait a moment: at a turn of its way a robot may be slow for an instant."""
        await self.until_flying(robot_ids, 3.0 * busy())

    async def has_told_of_holding(self, since_s: float, robot_ids: Iterable[int]) -> None:
        """Fail unless holding and flying on were each told, with a reason, and nothing twice.

        States say so first: events that waited for the bus come after them.
        """
        for robot_id in robot_ids:

            def done(robot_id: int = robot_id) -> bool:
                changes = self.witness.modes(robot_id, since_s)
                return bool(changes) and changes[-1].mode is wire.Mode.FLYING

            await until(done, PATIENCE_S, f"robot {robot_id} tells that it held and flies")
            changes = self.witness.modes(robot_id, since_s)
            # A change that a dying link took along is told by the next one's words.
            assert any(wire.Mode.HOLDING in (one.mode, one.previous) for one in changes), changes
            assert all(one.reason for one in changes), changes
        self.witness.check_once()

    def flies(self, robot_id: int) -> bool:
        """Tell whether a robot follows the planner and moves."""
        if self.witness.mode(robot_id) is not wire.Mode.FLYING:
            return False
        link = self.links.get(robot_id)
        told = self.witness.speed_m_s(robot_id)
        return (told if link is None else link.heard.speed_m_s) > MOVING_M_S

    def told_of(self, robot_ids: Iterable[int]) -> str:
        """Return what is known of some robots, for people who look for the cause."""
        lines = [
            f"robot {i}: {self.witness.mode(i)}, {self.witness.healths.get(i)}\n"
            + (self.bridges[i].log if i in self.bridges else "")
            for i in robot_ids
        ]
        picture = self.planner.snapshot
        for part in ("directives", "targets", "robots"):
            lines.append(f"{part}: {picture.get(part)}")
        return "\n".join(lines)


def _router(bus: str) -> tuple[str, ...]:
    return (*FALCONER, "router", str(FILE), "--listen", bus)


def _autopilots(scenario: Scenario, key: Path) -> dict[int, Autopilot]:
    robots = {robot.id: robot for robot in scenario.robots}
    return {
        robot_id: Autopilot(
            robot_id,
            "px4" if robot_id == PX4 else "ardupilot",
            free_port(socket.SOCK_DGRAM),
            robot_id,
            robots[robot_id].position,
            robots[robot_id].altitude_m,
            ("--signing-key", str(key), *LOSS) if robot_id == SIGNED else (),
        )
        for robot_id in (*STARTED, SPARE)
    }


@asynccontextmanager
async def team(folder: Path) -> AsyncIterator[Team]:
    """Start everything; yield it once all robots fly."""
    scenario = library.load(str(FILE))
    keys, port = TeamKeys(scenario.team), free_port()
    key, clock = folder / "key", folder / "clock"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o600)
    set_clock(clock, 0.0)
    environment = {
        "PYTHONPATH": f"{HERE / 'fakeclock'}{os.pathsep}{ROOT}",
        "WALL_CLOCK_OFFSET_FILE": str(clock),
    }
    autopilots = _autopilots(scenario, key)
    bus = f"tcp/127.0.0.1:{port}"
    async with AsyncExitStack() as stack:
        fleet = await stack.enter_async_context(Fleet())
        links = {
            i: await stack.enter_async_context(MavlinkLink(autopilot.port))
            for i, autopilot in autopilots.items()
        }
        bus_links = (
            await stack.enter_async_context(BusLink(port)),
            await stack.enter_async_context(BusLink(port)),
        )
        router = await fleet.start("router", _router(bus), "routing")
        settings = ZenohSettings(connect=(bus,))
        session = await stack.enter_async_context(ZenohBus(settings, keys.delivery))
        witness = Witness(keys, Inbox(keys.delivery))
        for topic in (Topic.STATE, Topic.HEALTH, Topic.EVENTS):
            await session.subscribe(keys.robot(None, topic), witness.inbox)
        listening = asyncio.create_task(witness.listen())
        stack.callback(listening.cancel)
        planner = Planner(scenario, bus, environment)
        made = Team(
            scenario, fleet, folder, port, environment, witness, session, planner, router, links,
            bus_links, autopilots,
        )  # fmt: skip
        stack.push_async_callback(_end_planner, made)
        await asyncio.gather(
            *(fleet.start(f"autopilot {i}", autopilots[i].command(), "at udpin") for i in STARTED),
            *(made.start_bridge(i) for i in STARTED),
            fleet.start("world", world(str(FILE), bus, (*STARTED, SPARE)), environment=environment),
            planner.start(),
        )
        await made.until_flying()
        yield made


async def _end_planner(made: Team) -> None:
    await made.planner.end(signal.SIGKILL)
