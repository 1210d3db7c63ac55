"""The two sites and everything that runs on them, each with a router of its own.

With the planner: router, server, mock model, robot 22 behind its MAVLink bridge. At the far site:
router, simulated world with robots 23 and 24, robot 21 behind its bridge, an observer.
"""

import asyncio
import json
import shutil
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Coroutine, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx

from benchmarks.field.forwarder import Forwarder
from benchmarks.field.tunnel import NEAR, Tunnel, entered
from benchmarks.field.ways import PacketWay, StreamWay, Weather
from benchmarks.fleet import FALCONER, Autopilot, Fleet, Running, free_port, world
from server.scenarios import library

FILE = Path(__file__).with_name("field.yaml")
HERE, AWAY = 22, (21, 23, 24)
BRIDGED = {21: "ardupilot", 22: "px4"}
TOKEN = "operator-of-the-field"
_PORT = 7447
_OBSERVER = (sys.executable, "-m", "benchmarks.field.observer")
_STAY = "ip link set lo up && echo up && exec sleep infinity"
_MAKE_NAMESPACE = (("unshare", "--net"), ("unshare", "--user", "--map-root-user", "--net"))
_PROBE = "ip link set lo up && ip tuntap add dev probe mode tun && exec nsenter --version"


class Separation(StrEnum):
    """What keeps the sites apart."""

    NAMESPACES = "namespaces"
    """Two network namespaces, joined by two TUN devices."""

    LOOPBACK = "loopback"
    """Two loopback addresses, joined by a TCP forwarder."""


def namespace_maker() -> tuple[str, ...] | None:
    """Return the command that runs another in a network of its own, None where none is allowed."""
    if any(shutil.which(tool) is None for tool in ("unshare", "nsenter", "ip")):
        return None
    for maker in _MAKE_NAMESPACE:
        probe = subprocess.run((*maker, "sh", "-c", _PROBE), capture_output=True, check=False)
        if probe.returncode == 0:
            return maker
    return None


@dataclass
class Field:
    """Everything that runs, and the link between the sites."""

    weather: Weather
    ways: tuple[PacketWay, PacketWay] | tuple[StreamWay, StreamWay]
    http: httpx.AsyncClient
    running: list[Running] = field(default_factory=list)
    heard: list[dict[str, Any]] = field(default_factory=list)
    """What the observer at the far site said, oldest first."""

    async def snapshot(self) -> dict[str, Any]:
        """Return the mission's newest snapshot, empty before the first."""
        answer = await self.http.get("/missions/m1/snapshot")
        return dict(answer.json()) if answer.status_code == httpx.codes.OK else {}

    async def events(self) -> list[dict[str, Any]]:
        """Return what the mission has told people."""
        answer = await self.http.get("/missions/m1/events")
        answer.raise_for_status()
        return list(answer.json()["events"])

    def robots(self) -> dict[int, dict[str, Any]]:
        """Return what the observer last heard of every robot."""
        last = self.heard[-1]["robots"] if self.heard else {}
        return {int(robot_id): told for robot_id, told in last.items()}

    def hear(self, line: str) -> None:
        """Take a line of the observer's."""
        if line.startswith("{"):
            self.heard.append(json.loads(line))


@dataclass(frozen=True)
class _Ground:
    """How the sites are reached."""

    link: Tunnel | Forwarder
    within: tuple[str, ...]
    """Put before a command, lets it run at the far site."""

    here: str
    """Where programs at the planner's site find their router."""

    away: str
    """The same at the far site."""

    across: str
    """Where the far router finds ours."""

    offered: str = ""
    """Where ours listens for it, if not at `here`."""


@asynccontextmanager
async def field_of(separation: Separation, seed: int) -> AsyncIterator[Field]:
    """Start everything on a good link; yield when the server has been started.

    Where the sites are namespaces this process must live in one of its own already.
    """
    weather, port, mock_port = Weather(), free_port(), free_port()
    lay = _namespaces if separation is Separation.NAMESPACES else _loopback
    async with AsyncExitStack() as stack:
        folder = stack.enter_context(TemporaryDirectory(prefix="falconer-field-"))
        fleet = await stack.enter_async_context(Fleet())
        ground = await lay(stack, fleet, weather, seed)
        http = httpx.AsyncClient(
            base_url=f"http://127.0.0.1:{port}/api/v1",
            headers={"authorization": f"Bearer {TOKEN}"},
            trust_env=False,
        )
        made = Field(weather, ground.link.ways, await stack.enter_async_context(http))
        model = f"http://127.0.0.1:{mock_port}/v1"
        listen = ",".join(filter(None, (ground.here, ground.offered)))
        made.running += [
            await fleet.start("router here", _router(listen), "routing"),
            await fleet.start(
                "router away",
                (*ground.within, *_router(ground.away, "--connect", ground.across)),
                "routing",
            ),
            await fleet.start(
                "mock model",
                (*FALCONER, "mock-llm", "--port", str(mock_port)),
                "mock language model on",
            ),
        ]
        made.running += await asyncio.gather(
            fleet.start(
                "observer",
                (*ground.within, *_OBSERVER, ground.away, library.load(str(FILE)).team),
                hear=made.hear,
            ),
            fleet.start("world", (*ground.within, *world(str(FILE), ground.away, sorted(BRIDGED)))),
            *_vehicle(fleet, 21, ground.within, ground.away),
            *_vehicle(fleet, HERE, (), ground.here),
            fleet.start(
                "server",
                (*FALCONER, "serve", str(FILE), "--port", str(port), "--llm", model),
                "Falconer on",
                {
                    "FALCONER_ZENOH_CONNECT": ground.here,
                    "FALCONER_LLM_BASE_URL": model,
                    "FALCONER_OPERATOR_TOKEN": TOKEN,
                    "FALCONER_DATABASE_URL": f"sqlite:///{folder}/journal.db",
                },
            ),
        )
        yield made


async def _namespaces(stack: AsyncExitStack, fleet: Fleet, weather: Weather, seed: int) -> _Ground:
    """Lay the link between this namespace and a new one that lives as long as the fleet."""
    far = await fleet.start("far namespace", ("unshare", "--net", "sh", "-c", _STAY), "up")
    tunnel = Tunnel(weather, far.process.pid, seed)
    await stack.enter_async_context(tunnel)
    bus = f"tcp/127.0.0.1:{_PORT}"
    offered = f"tcp/{NEAR}:{_PORT}"
    return _Ground(tunnel, entered(far.process.pid), bus, bus, offered, offered)


async def _loopback(stack: AsyncExitStack, fleet: Fleet, weather: Weather, seed: int) -> _Ground:
    """Lay the link between two loopback addresses."""
    here, away = free_port(), free_port()
    link = await stack.enter_async_context(Forwarder(weather, ("127.0.0.1", here), seed))
    return _Ground(
        link, (), f"tcp/127.0.0.1:{here}", f"tcp/127.0.0.2:{away}", f"tcp/127.0.0.1:{link.port}"
    )


def _router(listen: str, *more: str) -> tuple[str, ...]:
    return (*FALCONER, "router", str(FILE), "--listen", listen, *more)


def _vehicle(
    fleet: Fleet, robot_id: int, within: Sequence[str], bus: str
) -> list[Coroutine[Any, Any, Running]]:
    """Return the starts of an autopilot and its bridge, both at one site."""
    (robot,) = [one for one in library.load(str(FILE)).robots if one.id == robot_id]
    kind, port = BRIDGED[robot_id], free_port(socket.SOCK_DGRAM)
    pilot = Autopilot(
        robot_id, kind, port, robot_id, robot.position, robot.altitude_m, ("--setpoint-loss", "0.5")
    )
    return [
        fleet.start(f"autopilot {robot_id}", (*within, *pilot.command()), "at udpin"),
        fleet.start(f"bridge {robot_id}", (*within, *pilot.bridge(bus, str(FILE)))),
    ]
