"""A live mission that goes through everything, recorded, and the proof of its recording.

    python -m benchmarks.ordeal [--seconds 600] [--keep FILE.mcap]

Server, world, an autopilot with its bridge and a mock language model are processes of their own.
The model fails in many ways, robots run into zones, people comment and hold, and the bridge of one
robot is killed. Then the recording is verified by `falconer replay --verify`, and opened again
after it was cut at random bytes. Ends with exit code 1 when a promise is broken.
"""

import argparse
import asyncio
import json
import os
import random
import shutil
import signal
import socket
import sys
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

import httpx
import yaml

from benchmarks.fleet import FALCONER, Autopilot, Fleet, FleetError, Running, free_port, world
from benchmarks.report import verdict
from llm.mock.behaviours import Mode
from server.cli.progress import progress_bar
from server.recording.errors import RecordingError
from server.recording.reader import Recording, open_recording
from server.scenarios import library
from solver.engines.fast.compiled import compiled

SCENARIO = "mixed"
STEPS = 1_000_000
"""More than anybody waits for: the flight is stopped."""

LOST = 21
"""The robot whose bridge is killed."""

TOKEN = "operator-of-the-ordeal"
WAYS = (
    Mode.SOUND,
    Mode.GARBAGE,
    Mode.FAIL_500,
    Mode.OVER_CAPACITY,
    Mode.STALL,
    Mode.OUT_OF_BOUNDS,
    Mode.EMPTY,
    Mode.SOUND,
)
COMMENTS = (
    "The Drone 23 should focus on tracking target 104.",
    "Keep farther away from the sensing zones.",
    "Track more boldly.",
    "Robot 22 should not go near the communication zone.",
)
COMMENT_EVERY_S = 30.0
PATIENCE_S = 120.0
"""How long everybody may take to find each other, or to notice that somebody is gone."""

CLOSING_S = 60.0
LEAST_TICKS = 60
"""A slow machine flies for longer until it has flown so many."""

FAULTS = frozenset({"no_answer", "parsing", "verification"})
"""By whom a decision was refused where the model is to blame."""

CUTS = 200
HEADER_BYTES = 20_000
"""Within so many bytes a recording has said which mission it is of."""


@dataclass(frozen=True)
class Step:
    """Something that happens at a second of the flight."""

    at_s: float
    act: Callable[[], Awaitable[Any]]


@dataclass(frozen=True)
class Ordeal:
    """Everything that runs, and how it is disturbed."""

    http: httpx.AsyncClient
    mock: str
    """Address of the model's own routes."""

    bridge: Running

    async def behave(self, mode: Mode) -> None:
        """Let the model behave so from now on."""
        body = {"mode": mode.value, "delay_s": 8.0}
        async with httpx.AsyncClient(trust_env=False) as client:
            (await client.put(f"{self.mock}/mock/behaviour", json=body)).raise_for_status()

    async def post(self, route: str, body: dict[str, Any] | None = None) -> None:
        """Ask something of the mission."""
        (await self.http.post(f"/missions/m1/{route}", json=body)).raise_for_status()

    async def kill(self) -> None:
        """Kill the bridge, so that its robot is lost."""
        self.bridge.send(signal.SIGKILL)

    async def mourn(self) -> None:
        """Wait until everybody knows that the robot is lost."""
        await self.until(lambda links: links[LOST] == "lost", f"robot {LOST} is not missed")

    async def failed(self) -> None:
        """Wait until something was refused for the model's fault, so that it is in the flight."""
        async with asyncio.timeout(PATIENCE_S):
            while True:
                answer = await self.http.get("/missions/m1/decisions?limit=500")
                cards = answer.raise_for_status().json()["decisions"]
                if any(card["refused_by"] in FAULTS for card in cards):
                    return
                await asyncio.sleep(0.2)

    async def flown(self, ticks: int) -> None:
        """Wait until so many ticks have been flown: of fewer a proof says little."""
        async with asyncio.timeout(PATIENCE_S):
            while True:
                snapshot = await self.snapshot()
                if snapshot is not None and snapshot["tick"] >= ticks:
                    return
                await asyncio.sleep(0.2)

    async def snapshot(self) -> dict[str, Any] | None:
        """Return the newest snapshot, None before the first."""
        answer = await self.http.get("/missions/m1/snapshot")
        return dict(answer.json()) if answer.status_code == httpx.codes.OK else None

    async def until(self, wanted: Callable[[dict[int, str]], bool], what: str) -> None:
        """Wait until the robots' links are as wanted. Raises FleetError, with the bridge's log."""
        links: dict[int, str] = {}
        try:
            async with asyncio.timeout(PATIENCE_S):
                while True:
                    snapshot = await self.snapshot() or {"robots": []}
                    links = {robot["id"]: robot["link"] for robot in snapshot["robots"]}
                    if links and wanted(links):
                        return
                    await asyncio.sleep(0.2)
        except TimeoutError:
            raise FleetError(f"{what}: {links}\n{self.bridge.log}") from None

    def steps(self, seconds: float, ways: tuple[Mode, ...]) -> list[Step]:
        """Return what happens in a flight of so many seconds, in order."""
        share = seconds / len(ways)
        wrong = next(i for i, mode in enumerate(ways) if mode is not Mode.SOUND)
        found = [Step((wrong + 1) * share, self.failed)]
        found += [Step(i * share, partial(self.behave, mode)) for i, mode in enumerate(ways)]
        said = max(2, round(seconds / COMMENT_EVERY_S))
        for number in range(said):
            text = COMMENTS[number % len(COMMENTS)]
            say = partial(self.post, "comments", {"text": text})
            found.append(Step((number + 0.5) * seconds / said, say))
        found += [
            Step(0.3 * seconds, partial(self.post, "hold")),
            Step(0.3 * seconds + 2.0, partial(self.post, "resume")),
            Step(0.6 * seconds, self.kill),
        ]
        return sorted(found, key=lambda step: step.at_s)


@asynccontextmanager
async def ordeal(folder: Path) -> AsyncIterator[Ordeal]:
    """Start everything; yield it once all robots are connected. Recorded into the folder."""
    bus, port, mock_port = f"tcp/127.0.0.1:{free_port()}", free_port(), free_port()
    robot = next(robot for robot in library.named(SCENARIO).robots if robot.id == LOST)
    pilot = Autopilot(
        LOST,
        "ardupilot",
        free_port(socket.SOCK_DGRAM),
        LOST,
        robot.position,
        robot.altitude_m,
    )
    mock = f"http://127.0.0.1:{mock_port}"
    environment = {
        "FALCONER_ZENOH_LISTEN": bus,
        "FALCONER_OPERATOR_TOKEN": TOKEN,
        "FALCONER_RECORDINGS": str(folder),
        "FALCONER_DATABASE_URL": f"sqlite:///{folder}/journal.db",
    }
    serve = (*FALCONER, "serve", _endless(folder), "--llm", f"{mock}/v1", "--port", str(port))
    async with Fleet() as fleet:
        await fleet.start(
            "mock", (*FALCONER, "mock-llm", "--port", str(mock_port)), "mock language model"
        )
        bridge, *_ = await asyncio.gather(
            fleet.start("bridge", pilot.bridge(bus, SCENARIO)),
            fleet.start("autopilot", pilot.command(), "at udpin"),
            fleet.start("world", world(SCENARIO, bus, [LOST])),
            fleet.start("server", serve, "Falconer on", environment),
        )
        async with httpx.AsyncClient(
            base_url=f"http://127.0.0.1:{port}/api/v1",
            headers={"authorization": f"Bearer {TOKEN}"},
            timeout=30.0,
            trust_env=False,
        ) as http:
            made = Ordeal(http, mock, bridge)
            await made.until(lambda links: "lost" not in links.values(), "not all robots came")
            yield made


def _endless(folder: Path) -> str:
    """Write the scenario without an end of its own; return the file."""
    scenario = library.named(SCENARIO).model_dump(mode="json", exclude_unset=True)
    file = folder / "ordeal.yaml"
    file.write_text(yaml.safe_dump(scenario | {"steps": STEPS}), "utf-8")
    return str(file)


async def fly(folder: Path, seconds: float, ways: tuple[Mode, ...] = WAYS) -> Path:
    """Fly through everything and stop; return the finished recording."""
    async with ordeal(folder) as made:
        began_s = monotonic()
        with progress_bar("seconds flown", round(seconds)) as show:
            ending = [Step(seconds, made.mourn), Step(seconds, partial(made.flown, LEAST_TICKS))]
            for step in [*made.steps(seconds, ways), *ending]:
                while (flown_s := monotonic() - began_s) < step.at_s:
                    await asyncio.sleep(min(1.0, step.at_s - flown_s))
                    show(round(monotonic() - began_s))
                await step.act()
        await made.post("stop")
        return await _finished(folder)


async def _finished(folder: Path) -> Path:
    """Wait until the one recording of a folder is whole."""
    async with asyncio.timeout(CLOSING_S):
        while True:
            recording = await asyncio.to_thread(lambda: open_recording(next(folder.glob("*.mcap"))))
            if recording.complete:
                return recording.path
            await asyncio.sleep(0.2)


def contents(recording: Recording) -> dict[str, Any]:
    """Return what happened in a flight, counted."""
    events = list(recording.events())
    kinds = Counter(event["kind"] for event in events)
    cards = {
        event["data"]["decision"]["id"]: event["data"]["decision"]
        for event in events
        if event["kind"] == "decision"
    }
    lost = {event["data"]["robot"] for event in events if event["data"].get("link") == "lost"}
    said = [e for e in events if e["kind"] == "comment" and e["data"]["status"] == "received"]
    return {
        "duration_s": recording.duration_s,
        "size_bytes": recording.path.stat().st_size,
        "comments": len(said),
        "attacks": kinds["attack"],
        "holds": kinds["hold"],
        "lost_robots": sorted(lost),
        "decisions": len(cards),
        "refused": dict(Counter(c["refused_by"] for c in cards.values() if c["refused_by"])),
    }


async def verified(path: Path) -> dict[str, Any]:
    """Return what `falconer replay --verify` says of a recording."""
    process = await asyncio.create_subprocess_exec(
        *(*FALCONER, "replay", str(path), "--verify", "--json"), stdout=asyncio.subprocess.PIPE
    )
    printed, _ = await process.communicate()
    return {"exit_code": process.returncode, **json.loads(printed)}


def cut_anywhere(path: Path, cuts: int, seed: int = 0) -> dict[str, int]:
    """Cut a recording at random bytes; return how many pieces open and are sound to their end.

    A piece that ends within its header cannot say what it is of, and must be refused in words.
    """
    data, draw = path.read_bytes(), random.Random(seed)
    piece = path.with_name("piece.mcap")
    opened = refused = 0
    for _ in range(cuts):
        size = draw.randrange(len(data))
        piece.write_bytes(data[:size])
        try:
            found = open_recording(piece)
        except RecordingError:
            refused += size < HEADER_BYTES
            continue
        last = found.snapshot_at(found.duration_s)
        opened += not found.complete and (last is None or last["type"] == "snapshot")
    piece.unlink(missing_ok=True)
    return {"cuts": cuts, "opened": opened, "refused_within_header": refused}


def broken(figures: dict[str, Any]) -> list[str]:
    """Return the promises that the figures break, in words."""
    flown, proof, cuts = figures["flight"], figures["verification"], figures["cuts"]
    found = [
        f"no {name} in the flight"
        for name in ("comments", "attacks", "holds", "lost_robots")
        if not flown[name]
    ]
    if not FAULTS & set(flown["refused"]):
        found.append("the model never failed")
    if not proof["passed"] or proof["exit_code"]:
        found.append(f"{proof['different']} of {proof['ticks']} ticks differ: {proof}")
    if not proof["complete"]:
        found.append("the recording was not finished")
    if cuts["opened"] + cuts["refused_within_header"] != cuts["cuts"]:
        found.append(f"not every piece opens: {cuts}")
    return found


async def measure(folder: Path, seconds: float, ways: tuple[Mode, ...] = WAYS) -> dict[str, Any]:
    """Fly, verify and cut; return the figures."""
    # The kernels are compiled before anybody waits for a mission that needs them.
    await asyncio.to_thread(compiled)
    load = os.getloadavg()[0]
    path = await fly(folder, seconds, ways)
    flown = await asyncio.to_thread(lambda: contents(open_recording(path)))
    began_s = monotonic()
    proof = await verified(path)
    return {
        "load": [round(load, 1), round(os.getloadavg()[0], 1)],
        "recording": str(path),
        "flight": flown,
        "verification": proof,
        "verification_s": round(monotonic() - began_s, 1),
        "cuts": await asyncio.to_thread(cut_anywhere, path, CUTS),
    }


def main() -> int:
    """Measure and print; return 1 when a promise is broken."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ordeal", description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="length of the flight")
    parser.add_argument("--keep", type=Path, help="where the recording is copied to")
    given = parser.parse_args()
    with TemporaryDirectory(prefix="falconer-ordeal-") as folder:
        figures = asyncio.run(measure(Path(folder), given.seconds))
        if given.keep is not None:
            shutil.copy(figures["recording"], given.keep)
    return verdict(figures, broken(figures))


if __name__ == "__main__":
    sys.exit(main())
