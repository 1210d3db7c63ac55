"""A live mission in its real processes, watched from outside: ticks, events, directives.

The mission process, the simulated world and the journal are the product's own. What is timed
is when each snapshot arrives at this end of the pipe, against the schedule that it names.
"""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import httpx
import numpy as np
import uvicorn

from llm.mock.app import create_app
from llm.mock.behaviours import Mode
from server.api.catalogue import Definition
from server.api.definitions import define_live
from server.api.library import ScenarioLibrary
from server.api.service import MissionService
from server.journal.database import DatabaseJournal
from server.journal.store import Store
from server.live.host import ProcessHost, Receive
from server.live.outbox import Frame
from server.live.world import WorldHost
from server.mission.setup import MissionSetup
from server.settings import Settings
from vehicles.world.setup import WorldSetup

MISSION = "m1"
START_S = 120.0
LOOK_S = 0.02


@dataclass(frozen=True, slots=True)
class Ticks:
    """How punctual the snapshots of a stretch of time were."""

    ticks: int
    """Schedule positions passed, missed ones included."""

    missed: int
    late_p50_ms: float
    late_p99_ms: float
    late_max_ms: float
    """Arrival after the schedule, over the most punctual snapshot of the whole run."""

    @property
    def missed_share(self) -> float:
        """Return which part of the schedule was missed."""
        return self.missed / max(1, self.ticks)


@dataclass(eq=False)
class Watch:
    """Everything a mission has told, with the monotonic time of its arrival."""

    told: list[tuple[float, dict[str, Any]]] = field(default_factory=list)
    _news: asyncio.Event = field(default_factory=asyncio.Event)

    def take(self, frame: Frame) -> None:
        """Take a frame."""
        self.told.append((time.monotonic(), frame.data))
        self._news.set()

    async def until(self, condition: Callable[[], bool], within_s: float) -> None:
        """Wait until a condition holds that only news can bring about. Raises TimeoutError."""
        async with asyncio.timeout(within_s):
            while not condition():
                self._news.clear()
                await self._news.wait()

    @property
    def events(self) -> list[dict[str, Any]]:
        """All events."""
        return [said for _, said in self.told if said["type"] == "event"]

    @property
    def snapshots(self) -> list[dict[str, Any]]:
        """All snapshots of the flight itself."""
        return [said for _, said in self._flying(0.0, np.inf)]

    def calls(self) -> dict[str, int]:
        """Return how many calls each model loop has ended."""
        last = self.snapshots[-1] if self.snapshots else {"loops": {}}
        loops = last["loops"]
        return {name: loops[name]["calls"] for name in loops if name.endswith("_llm")}

    def ticks(self, from_s: float, until_s: float) -> Ticks:
        """Return the figures of a stretch of monotonic time."""
        chosen = self._flying(from_s, until_s)
        if len(chosen) < 2:
            return Ticks(0, 0, np.nan, np.nan, np.nan)
        best = min(at - said["time_s"] for at, said in self._flying(0.0, np.inf))
        late = 1e3 * np.array([at - said["time_s"] - best for at, said in chosen])
        first, last = chosen[0][1], chosen[-1][1]
        missed = last["loops"]["optimizer"]["missed"] - first["loops"]["optimizer"]["missed"]
        return Ticks(
            ticks=last["tick"] - first["tick"] + missed,
            missed=missed,
            late_p50_ms=float(np.percentile(late, 50)),
            late_p99_ms=float(np.percentile(late, 99)),
            late_max_ms=float(late.max()),
        )

    def _flying(self, from_s: float, until_s: float) -> list[tuple[float, dict[str, Any]]]:
        """Return one message per tick: the first that tells of it."""
        seen: set[int] = set()
        chosen = []
        for at, said in self.told:
            if said["type"] != "snapshot" or said["state"] != "running" or said["tick"] < 0:
                continue
            if said["tick"] not in seen and from_s <= at <= until_s:
                chosen.append((at, said))
            seen.add(said["tick"])
        return chosen


def outside(said: dict[str, Any]) -> list[str]:
    """Return what of a snapshot's directives lies outside of what may ever be in force."""
    bare = uncovered(said)
    return beyond(said) + ([f"targets without a robot {bare}"] if bare else [])


def beyond(said: dict[str, Any]) -> list[str]:
    """Return which of a snapshot's directives are beyond their bounds, in words."""
    directives, wrong = said["directives"], []
    for name, weight in directives["weights"].items():
        lower, upper = directives["weight_bounds"][name]
        if weight is None or not lower <= weight <= upper:
            wrong.append(f"{name} {weight}")
    wrong += [f"severity {z} {s}" for z, s in directives["severities"].items() if not 1 <= s <= 5]
    capacities = directives["capacities"]
    for robot, row in directives["assignment"].items():
        if len(row) > capacities[robot] or len(set(row)) != len(row):
            wrong.append(f"robot {robot} has {row}")
    strangers = _given(said) - {target["id"] for target in said["targets"]}
    if strangers:
        wrong.append(f"unknown targets {sorted(strangers)}")
    return wrong


def uncovered(said: dict[str, Any]) -> list[int]:
    """Return the targets that no robot has, though none is lost."""
    if any(robot["link"] == "lost" for robot in said["robots"]):
        return []
    return sorted({target["id"] for target in said["targets"]} - _given(said))


def _given(said: dict[str, Any]) -> set[int]:
    return {target for row in said["directives"]["assignment"].values() for target in row}


class _Watched(ProcessHost):
    """A mission process whose every frame is watched."""

    def __init__(self, watch: Watch) -> None:
        super().__init__()
        self._watch = watch

    async def run(self, receive: Receive) -> int:
        def both(frame: Frame) -> None:
            self._watch.take(frame)
            receive(frame)

        return await super().run(both)


@asynccontextmanager
async def live_mission(
    setup: MissionSetup, world: WorldSetup, llm: str, watch: Watch, settings: Settings
) -> AsyncIterator[MissionService]:
    """Fly a mission as `m1` until the block ends; it has begun when the block does."""

    def planner(_: Definition) -> ProcessHost:
        return _Watched(watch)

    def simulated(_: Definition) -> WorldHost:
        return WorldHost()

    with TemporaryDirectory() as folder:
        store = Store(f"sqlite:///{Path(folder) / 'journal.db'}")
        async with (
            DatabaseJournal(store) as journal,
            MissionService(ScenarioLibrary(settings), planner, simulated, journal) as service,
        ):
            await service.add(define_live(setup, world, llm, settings), "benchmark")
            await service.start(MISSION, "benchmark")
            await watch.until(lambda: bool(watch.snapshots), START_S)
            yield service


@dataclass(frozen=True, slots=True)
class MockServer:
    """The mock language model over TCP, in a thread of this process."""

    url: str
    """With its version, as a model's address."""

    def behave(self, mode: Mode, delay_s: float) -> None:
        """Make it behave so from now on."""
        address = f"{self.url.removesuffix('/v1')}/mock/behaviour"
        body = {"mode": mode.value, "delay_s": delay_s}
        httpx.put(address, json=body, trust_env=False).raise_for_status()


@contextmanager
def served_mock() -> Iterator[MockServer]:
    """Serve the mock on a free port of 127.0.0.1 while the block runs."""
    config = uvicorn.Config(create_app(), host="127.0.0.1", port=0, log_level="critical")
    server = uvicorn.Server(config)
    # Nobody waits for replies that stall on purpose.
    config.timeout_graceful_shutdown = 1
    thread = threading.Thread(target=server.run, name="mock", daemon=True)
    thread.start()
    try:
        while not server.started:
            time.sleep(LOOK_S)
        port = server.servers[0].sockets[0].getsockname()[1]
        yield MockServer(f"http://127.0.0.1:{port}/v1")
    finally:
        server.should_exit = True
        thread.join(10.0)
