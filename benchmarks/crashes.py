"""Kill the server at random moments of a live mission, start it again, and compare.

    python -m benchmarks.crashes [--kills 20] [--seed 0] [--scenario hardware]

The vehicles are a simulated world of their own process on a bus of its own, so that they live
on. Each time: SIGKILL after a random while of comments, holds and resumes; the vehicles must
hold; the server is started again with the same command; the journal must verify, and the mission
must stand there held, with every acknowledged comment, its directives and its known zones.
"""

import argparse
import asyncio
import contextlib
import math
import os
import random
import signal
import sys
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx

from server.journal.store import Store
from server.journal.verification import Verification, verify
from server.live.saving import CHECKPOINT_S
from server.scenarios import library
from tests.patience import busy
from vehicles import messages as wire
from vehicles.inbox import Inbox
from vehicles.keys import TeamKeys, Topic
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

TOKEN = "operator-of-the-crashes"
START_S = 120.0
HOLD_WITHIN_S = 1.5
"""Setpoints live half a second, robots brake, and this machine may be busy."""

STILL_M_S = 0.05
ANSWER_S = 20.0
"""Of the server, which may be busy."""

DECIDED = ("assignment", "weights", "capacities", "severities")
"""The directives that must be as they were, or as a decision made them since."""


class Broken(AssertionError):
    """Raised when something did not outlive a kill; says what."""


@dataclass
class Server:
    """`falconer serve` as a process, and what its clients were told."""

    command: list[str]
    environment: dict[str, str]
    process: asyncio.subprocess.Process | None = None
    address: str = ""
    log: list[str] = field(default_factory=list)
    _reader: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Start it and wait until it says where it listens."""
        self.process = await asyncio.create_subprocess_exec(
            *self.command, stderr=asyncio.subprocess.PIPE, env=self.environment
        )
        self.address = ""
        self._reader = asyncio.create_task(self._read(self.process))
        until_s = time.monotonic() + START_S
        while not self.address:
            if self.process.returncode is not None or time.monotonic() > until_s:
                raise Broken("the server did not start:\n" + "\n".join(self.log[-20:]))
            await asyncio.sleep(0.02)

    async def kill(self) -> None:
        """Kill it, and nothing else: its children notice by themselves."""
        if self.process is None or self._reader is None:
            return
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(signal.SIGKILL)
        await self.process.wait()
        await self._reader
        self.process = None

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stderr is not None
        async for raw in process.stderr:
            line = raw.decode("utf-8", "replace").rstrip()
            self.log.append(line)
            if line.startswith("Falconer on "):
                self.address = line.split()[2]


@dataclass
class Vehicles:
    """What the robots report, whoever plans for them."""

    bus: ZenohBus
    inbox: Inbox
    keys: TeamKeys
    speeds: dict[int, float] = field(default_factory=dict)

    def fastest_m_s(self) -> float:
        """Return the speed of the fastest robot that has reported since the last call."""
        self.speeds.clear()
        for sample in self.inbox.drain():
            state = wire.decode(wire.State, sample.payload)
            self.speeds[state.robot_id] = math.hypot(*state.velocity)
        return max(self.speeds.values(), default=0.0)


@dataclass
class Campaign:
    """One mission, killed again and again."""

    server: Server
    vehicles: Vehicles
    journal: str
    dice: random.Random
    comments: dict[str, str] = field(default_factory=dict)
    """Every comment that was acknowledged, by id."""

    seen: list[dict[str, Any]] = field(default_factory=list)
    """Snapshots in the order in which they were read."""

    settled: int = 0
    """So many of them had been read when the newest acknowledged comment was said.

    What a snapshot shows is kept before it is shown, so that it is on the disk with whatever is
    acknowledged after it.
    """

    def client(self) -> httpx.AsyncClient:
        """Return an operator's client of the server as it runs now."""
        headers = {"authorization": f"Bearer {TOKEN}"}
        base = f"{self.server.address}/api/v1"
        return httpx.AsyncClient(base_url=base, headers=headers, timeout=ANSWER_S)

    async def round(self) -> str:
        """Fly for a while, kill, start again, compare; return a line about it."""
        async with self.client() as client:
            await self._wait(client, {"running", "held"})
            await client.post("/missions/m1/resume")
            await self._wait(client, {"running"})
            flying_s = self.dice.uniform(0.3, 4.0)
            await self._use(client, flying_s)
        killed_s = time.monotonic()
        await self.server.kill()
        held_s = await self._hold_seen()
        await self.server.start()
        async with self.client() as client:
            snapshot = await self._wait(client, {"held"})
            said = (await client.get("/missions/m1/comments?limit=1000")).json()
            cards = await self._cards(client)
        up_s = time.monotonic() - killed_s
        self.compare(snapshot, said, cards)
        found = await verified(self.journal)
        if not found.sound:
            raise Broken(f"the journal does not verify: {found.problems}")
        return (
            f"killed after {flying_s:.2f} s, vehicles held within {held_s:.2f} s, held mission up"
            f" after {up_s:.1f} s; {len(self.comments)} comments, {len(snapshot['zones'])} zones,"
            f" {found.entries} entries verify"
        )

    async def _use(self, client: httpx.AsyncClient, duration_s: float) -> None:
        """Comment, hold, resume and look at random until the time is over."""
        until_s = time.monotonic() + duration_s
        while time.monotonic() < until_s:
            chance = self.dice.random()
            if chance < 0.3:
                text = f"Note {self.dice.randrange(10**6)}: keep well clear of each other."
                read = len(self.seen)
                answer = await client.post("/missions/m1/comments", json={"text": text})
                if answer.status_code == httpx.codes.CREATED:
                    self.comments[answer.json()["id"]] = text
                    self.settled = read
            elif chance < 0.4:
                await client.post("/missions/m1/hold")
                await client.post("/missions/m1/resume")
            looked = await client.get("/missions/m1/snapshot")
            if looked.status_code == httpx.codes.OK:
                self.seen.append(looked.json())
            await asyncio.sleep(self.dice.uniform(0.0, 0.1))

    async def _hold_seen(self) -> float:
        """Return after how many seconds every robot that reports stands still."""
        began_s = time.monotonic()
        while time.monotonic() < began_s + HOLD_WITHIN_S + 2.0 * busy():
            self.vehicles.fastest_m_s()
            await asyncio.sleep(0.25)
            if self.vehicles.fastest_m_s() < STILL_M_S and self.vehicles.speeds:
                return time.monotonic() - began_s
        raise Broken("the vehicles fly on without a planner")

    async def _wait(self, client: httpx.AsyncClient, states: set[str]) -> dict[str, Any]:
        """Return the first snapshot in one of some states."""
        until_s = time.monotonic() + START_S
        told: Any = None
        while time.monotonic() < until_s:
            answer = await client.get("/missions/m1/snapshot")
            told = answer.json()
            if answer.status_code == httpx.codes.OK and told["state"] in states:
                return dict(told)
            await asyncio.sleep(0.05)
        raise Broken(f"the mission did not become {' or '.join(states)}: {str(told)[:300]}")

    async def _cards(self, client: httpx.AsyncClient) -> list[dict[str, Any]]:
        """Return every decision that the mission has kept, oldest first."""
        cards: list[dict[str, Any]] = []
        after = 0
        while True:
            url = f"/missions/m1/decisions?limit=100&after={after}"
            page = (await client.get(url)).json()
            if not page["decisions"]:
                return cards
            cards += page["decisions"]
            after = page["next_after"]

    def compare(
        self,
        snapshot: dict[str, Any],
        said: list[dict[str, Any]],
        cards: list[dict[str, Any]],
    ) -> None:
        """Raise Broken unless a mission's first snapshot continues what was seen before a kill.

        `said` and `cards` are its comments and decisions as they are told now.
        """
        known = {comment["id"]: comment["text"] for comment in said}
        lost = {cid: text for cid, text in self.comments.items() if known.get(cid) != text}
        if lost:
            raise Broken(f"acknowledged comments are missing: {lost}")
        if not self.settled:
            return
        settled, *later = self.seen[self.settled - 1 :]
        zones = {zone["id"] for zone in settled["zones"]}
        if not zones <= {zone["id"] for zone in snapshot["zones"]}:
            raise Broken(f"known zones are missing: {zones}")
        seen = [s["directives"] for s in (settled, *later)]
        for name in DECIDED:
            # What was decided after the last look, or since the start, nobody has seen.
            allowed = [d[name] for d in (*seen, *decided_since(settled, cards))]
            if snapshot["directives"][name] not in allowed:
                raise Broken(f"{name} is {snapshot['directives'][name]}, was one of {allowed}")
        if snapshot["time_s"] < settled["time_s"] - CHECKPOINT_S:
            raise Broken(f"mission time went back to {snapshot['time_s']} s")


def decided_since(
    snapshot: dict[str, Any], cards: list[dict[str, Any]]
) -> Iterator[dict[str, Any]]:
    """Yield what the directives of a snapshot became, decision by decision."""
    now = {name: dict(snapshot["directives"][name]) for name in DECIDED}
    for card in cards:
        if card["status"] != "adopted" or card["decided_s"] < snapshot["time_s"]:
            continue
        changes = card["changes"]
        for row in changes["assignment"]:
            targets = {*now["assignment"][str(row["robot"])], *row["gains"]} - {*row["loses"]}
            now["assignment"][str(row["robot"])] = sorted(targets)
        for name in ("weights", "capacities", "severities"):
            now[name] |= {of: new for of, (_, new) in changes[name].items()}
        # A severity of 1 stands for itself.
        now["severities"] = {of: value for of, value in now["severities"].items() if value != 1.0}
        yield {name: dict(values) for name, values in now.items()}


async def verified(address: str) -> Verification:
    """Return what reading the whole journal finds; the server may be writing meanwhile."""
    store = Store(address)
    await store.open_to_read()
    try:
        return await verify(store)
    finally:
        await store.close()


@asynccontextmanager
async def campaign(scenario: str, folder: Path, seed: int) -> AsyncIterator[Campaign]:
    """Open a bus, put a simulated world on it, and start a server that flies the scenario."""
    keys = TeamKeys(library.named(scenario).mission_setup().team)
    router = ZenohSettings(mode=ZenohMode.ROUTER, listen=("tcp/127.0.0.1:0",))
    journal = f"sqlite:///{folder / 'journal.db'}"
    environment = {k: v for k, v in os.environ.items() if not k.startswith("FALCONER_")}
    environment |= {"FALCONER_DATABASE_URL": journal, "FALCONER_OPERATOR_TOKEN": TOKEN}
    async with ZenohBus(router, keys.delivery) as bus:
        endpoint = bus.endpoints[0]
        falconer = [sys.executable, "-m", "server.cli"]
        world = await asyncio.create_subprocess_exec(
            *falconer, "sim", scenario, "--connect", endpoint,
            stderr=asyncio.subprocess.DEVNULL, env=environment,
        )  # fmt: skip
        command = [*falconer, "serve", scenario, "--port", "0", "--zenoh-connect", endpoint]
        server = Server(command, environment)
        inbox = Inbox(keys.delivery)
        watched = await bus.subscribe(keys.robot(None, Topic.STATE), inbox)
        try:
            await server.start()
            vehicles = Vehicles(bus, inbox, keys)
            yield Campaign(server, vehicles, journal, random.Random(seed))
        finally:
            await server.kill()
            with contextlib.suppress(ProcessLookupError):
                world.terminate()
            await world.wait()
            await watched.close()


async def _run(kills: int, scenario: str, seed: int) -> None:
    with TemporaryDirectory(prefix="falconer-crashes-") as folder:
        async with campaign(scenario, Path(folder), seed) as killed:
            for number in range(1, kills + 1):
                print(f"{number:3d}  {await killed.round()}", flush=True)
    print(f"{kills} kills, nothing lost")


def main() -> None:
    """Run the program."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenario", default="hardware")
    chosen = parser.parse_args()
    asyncio.run(_run(chosen.kills, chosen.scenario, chosen.seed))


if __name__ == "__main__":
    main()
