"""A live mission of MAVLink vehicles and simulated robots: `python -m benchmarks.mixed`.

Starts the server, the simulated world, two simulated autopilots (ArduPilot and PX4) with their
bridges, all as processes over real sockets, and lets them fly the scenario `mixed`. Then it tells
what was missed, refused and ignored, the longest a robot waited for a setpoint, and how far the
tracks were from the truth. Ends with exit code 1 when a promise is broken.
"""

import argparse
import asyncio
import os
import re
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from math import dist
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

import httpx

from benchmarks.fleet import FALCONER, Autopilot, Fleet, Running, free_port, world
from benchmarks.report import verdict
from server.cli.progress import progress_bar
from server.scenarios import library
from vehicles import messages as wire
from vehicles.alongside import alongside
from vehicles.inbox import Inbox
from vehicles.keys import Delivery, TeamKeys, Topic
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohSettings

SCENARIO = "mixed"
EXTERNAL = {21: "ardupilot", 22: "px4"}
TOKEN = "operator-of-the-benchmark"
ANSWER_S = 30.0
LOOK_S = 0.02
MEETING_S = 120.0
"""How long everybody may take to find each other; it is not what is measured."""


@dataclass
class Watch:
    """What is heard on the bus of every robot."""

    inbox: Inbox
    states: dict[int, wire.State] = field(default_factory=dict)
    healths: dict[int, wire.Health] = field(default_factory=dict)
    events: list[wire.Event] = field(default_factory=list)
    setpoints: dict[int, int] = field(default_factory=dict)
    heard_s: dict[int, float] = field(default_factory=dict)
    longest_s: dict[int, float] = field(default_factory=dict)
    modes: dict[int, set[str]] = field(default_factory=dict)

    def hear(self, keys: TeamKeys) -> None:
        """Take what has arrived."""
        now_s = monotonic()
        for sample in self.inbox.drain():
            address = keys.parse(sample.key)
            if address is None or address.robot_id is None:
                continue
            robot_id = address.robot_id
            match address.topic:
                case Topic.STATE:
                    self.states[robot_id] = wire.decode(wire.State, sample.payload)
                    self.modes.setdefault(robot_id, set()).add(self.states[robot_id].mode.value)
                case Topic.HEALTH:
                    self.healths[robot_id] = wire.decode(wire.Health, sample.payload)
                case Topic.EVENTS:
                    self.events.append(wire.decode(wire.Event, sample.payload))
                case Topic.SETPOINT:
                    last_s = self.heard_s.get(robot_id, now_s)
                    longest_s = max(self.longest_s.get(robot_id, 0.0), now_s - last_s)
                    self.longest_s[robot_id] = longest_s
                    self.heard_s[robot_id] = now_s
                    self.setpoints[robot_id] = self.setpoints.get(robot_id, 0) + 1

    def forget(self) -> None:
        """Count from now on."""
        self.setpoints.clear()
        self.longest_s.clear()
        self.events.clear()
        self.modes.clear()

    def refusals(self) -> list[str]:
        """Return what was refused of setpoints and orders, in words."""
        return [
            f"robot {event.robot_id}: {event.event.text}"
            for event in self.events
            if isinstance(event.event, wire.NoticePart) and event.event.code == "refused"
        ]


@dataclass
class Mission:
    """Everything that flies, and how it is asked."""

    watch: Watch
    keys: TeamKeys
    http: httpx.AsyncClient
    autopilots: list[Running]

    async def snapshot(self) -> dict[str, Any]:
        """Return the mission's newest snapshot."""
        answer = await self.http.get("/missions/m1/snapshot")
        answer.raise_for_status()
        values: dict[str, Any] = answer.json()
        return values

    async def listen(self) -> None:
        """Listen for ever."""
        while True:
            self.watch.hear(self.keys)
            await asyncio.sleep(LOOK_S)

    async def events(self, after: int = 0) -> list[dict[str, Any]]:
        """Return what the mission has told people after an event of a number."""
        found: list[dict[str, Any]] = []
        while True:
            url = f"/missions/m1/events?limit=500&after={found[-1]['seq'] if found else after}"
            page = (await self.http.get(url)).raise_for_status().json()["events"]
            if not page:
                return found
            found += page

    async def until_tracked(self) -> dict[str, Any]:
        """Return the first snapshot that shows every target tracked, or that of the last moment.

        The track of a robot that a zone has blinded goes on without being seen until it is out.
        """
        until_s = monotonic() + MEETING_S
        while True:
            snapshot = await self.snapshot()
            seen = all(track["status"] == "tracked" for track in snapshot["targets"])
            if seen or monotonic() > until_s:
                return snapshot
            await asyncio.sleep(0.2)


@asynccontextmanager
async def mission(llm: str = "mock") -> AsyncIterator[Mission]:
    """Start everything; yield it once all robots fly."""
    scenario = library.named(SCENARIO)
    keys = TeamKeys(scenario.team)
    bus, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    robots = {robot.id: robot for robot in scenario.robots}
    pilots = [
        Autopilot(
            robot_id,
            kind,
            free_port(socket.SOCK_DGRAM),
            robot_id,
            robots[robot_id].position,
            robots[robot_id].altitude_m,
        )
        for robot_id, kind in EXTERNAL.items()
    ]
    async with AsyncExitStack() as stack:
        folder = stack.enter_context(TemporaryDirectory(prefix="falconer-mixed-"))
        fleet = await stack.enter_async_context(Fleet())
        flown, *_ = await asyncio.gather(
            asyncio.gather(
                *(fleet.start(f"autopilot {p.robot_id}", p.command(), "at udpin") for p in pilots)
            ),
            fleet.start("world", world(SCENARIO, bus, list(EXTERNAL))),
            *(fleet.start(f"bridge {p.robot_id}", p.bridge(bus, SCENARIO)) for p in pilots),
            fleet.start(
                "server",
                (*FALCONER, "serve", SCENARIO, "--llm", llm, "--port", str(port)),
                "Falconer on",
                {
                    "FALCONER_ZENOH_LISTEN": bus,
                    "FALCONER_OPERATOR_TOKEN": TOKEN,
                    "FALCONER_DATABASE_URL": f"sqlite:///{folder}/journal.db",
                },
            ),
        )
        async with (
            ZenohBus(ZenohSettings(connect=(bus,), open_timeout_s=60.0), keys.delivery) as session,
            httpx.AsyncClient(
                base_url=f"http://127.0.0.1:{port}/api/v1",
                headers={"authorization": f"Bearer {TOKEN}"},
                timeout=ANSWER_S,
                trust_env=False,
            ) as http,
        ):
            watch = Watch(counting_inbox(keys))
            for topic in (Topic.STATE, Topic.HEALTH, Topic.EVENTS, Topic.SETPOINT):
                await session.subscribe(keys.robot(None, topic), watch.inbox)
            made = Mission(watch, keys, http, list(flown))
            async with alongside(made.listen()):
                async with asyncio.timeout(MEETING_S):
                    while not _all_fly(watch, set(robots)):  # noqa: ASYNC110
                        await asyncio.sleep(0.2)
                yield made
            await made.http.post("/missions/m1/stop")


def counting_inbox(keys: TeamKeys) -> Inbox:
    """Return an inbox in which no setpoint replaces another one: they are counted."""

    def delivery(key: str) -> Delivery:
        address = keys.parse(key)
        counted = address is not None and address.topic is Topic.SETPOINT
        return Delivery.EVENT if counted else keys.delivery(key)

    return Inbox(delivery)


def _all_fly(watch: Watch, robots: set[int]) -> bool:
    flying = {robot_id for robot_id, s in watch.states.items() if s.mode is wire.Mode.FLYING}
    return flying == robots and set(watch.healths) == robots


async def measure(seconds: float, llm: str) -> dict[str, Any]:
    """Fly for so long; return the figures."""
    errors_m: list[float] = []
    async with mission(llm) as made:
        told = await made.events()
        before = await made.snapshot()
        refused = {robot_id: health.refused for robot_id, health in made.watch.healths.items()}
        made.watch.forget()
        began_s, load = monotonic(), os.getloadavg()[0]
        with progress_bar("seconds flown", round(seconds)) as show:
            while monotonic() - began_s < seconds:
                await asyncio.sleep(1.0)
                errors_m += _errors_m(await made.snapshot())
                show(round(monotonic() - began_s))
        after, took_s = await made.snapshot(), monotonic() - began_s
        counted = dict(sorted(made.watch.setpoints.items()))
        news = await made.events(told[-1]["seq"] if told else 0)
        tracked = await made.until_tracked()
        watch = made.watch
    ticks = [one["loops"]["optimizer"] for one in (before, after)]
    return {
        "seconds": round(took_s, 1),
        "mission_s": round(after["time_s"] - before["time_s"], 3),
        "load": [round(load, 1), round(os.getloadavg()[0], 1)],
        "ticks": ticks[1]["calls"] - ticks[0]["calls"],
        "missed_ticks": ticks[1]["missed"] - ticks[0]["missed"],
        "setpoints": counted,
        "cut_off": sorted(_cut_off(before) | _cut_off(after) | _lost_touch(news)),
        "longest_wait_s": {k: round(v, 3) for k, v in sorted(watch.longest_s.items())},
        "refused_on_board": {
            robot_id: health.refused - refused[robot_id]
            for robot_id, health in sorted(watch.healths.items())
        },
        "refusals": watch.refusals(),
        "autopilots": {one.name: _counted(one) for one in made.autopilots},
        "modes": {robot_id: sorted(modes) for robot_id, modes in sorted(watch.modes.items())},
        "tracked": [track["status"] for track in tracked["targets"]],
        "mean_error_m": round(sum(errors_m) / len(errors_m), 3) if errors_m else None,
        "attacks": after["attacks"],
    }


def _cut_off(snapshot: dict[str, Any]) -> set[int]:
    """Return the robots that the planner does not reach."""
    return {robot["id"] for robot in snapshot["robots"] if robot["link"] != "connected"}


def _lost_touch(events: list[dict[str, Any]]) -> set[int]:
    """Return the robots that the planner has told it does not reach."""
    links = [event["data"] for event in events if "link" in (event["data"] or {})]
    return {data["robot"] for data in links if data["link"] != "connected"}


def _counted(autopilot: Running) -> list[int]:
    """Return the setpoints that an autopilot took and ignored, by its last line."""
    found = re.search(r"(\d+) setpoints taken, (\d+) ignored", autopilot.log)
    return [int(number) for number in found.groups()] if found else []


def _errors_m(snapshot: dict[str, Any]) -> list[float]:
    truth = {target["id"]: target["position"] for target in snapshot["truth"]["targets"]}
    return [dist(track["position"], truth[track["id"]]) for track in snapshot["targets"]]


def broken(figures: dict[str, Any]) -> list[str]:
    """Return the promises that the figures break, in words."""
    found = []
    if figures["missed_ticks"]:
        found.append(f"{figures['missed_ticks']} of {figures['ticks']} ticks missed")
    if any(figures["refused_on_board"].values()) or figures["refusals"]:
        found.append(f"setpoints refused: {figures['refused_on_board']} {figures['refusals']}")
    if any(len(counts) != 2 or counts[1] for counts in figures["autopilots"].values()):
        found.append(f"setpoints ignored by autopilots: {figures['autopilots']}")
    if set(figures["tracked"]) != {"tracked"}:
        found.append(f"targets not tracked: {figures['tracked']}")
    return found


def main() -> int:
    """Measure and print; return 1 when a promise is broken."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mixed", description=__doc__)
    parser.add_argument("--seconds", type=float, default=300.0, help="length of the flight")
    parser.add_argument("--llm", default="mock", help="who advises, as for falconer serve")
    given = parser.parse_args()
    figures = asyncio.run(measure(given.seconds, given.llm))
    return verdict(figures, broken(figures))


if __name__ == "__main__":
    sys.exit(main())
