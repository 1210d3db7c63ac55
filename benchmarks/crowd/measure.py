"""A live mission under a crowd: what it costs the mission, the clients and the server."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.crowd.clients import (
    OPEN_S,
    Received,
    Stalled,
    read_stream,
    show_console,
    show_scene,
    stalled_console,
    stalled_scene,
    stalled_stream,
)
from benchmarks.crowd.server import HEADERS, MISSION, Cost, Server, flying
from console.page import KEPT_S

P99_S: Final = 0.150
GROWTH: Final = 0.03
"""Of the web process's memory, from a quarter of the time to its end: more is not flat."""

LOOK_S: Final = 1.0
LEAVE_S: Final = KEPT_S + 10.0
"""A page is kept for a while after its browser has gone."""

APART_S: Final = 0.02
"""Between two clients' arrivals."""

SLACK_HANDLES: Final = 8
"""Kept-alive connections of our own, and the journal's files."""

Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Crowd:
    """How many of each kind come, beside one of each that stalls, and for how long."""

    streams: int = 50
    consoles: int = 10
    scenes: int = 3
    """So many consoles show the scene as well."""

    seconds: float = 300.0
    settle_s: float = 10.0


@dataclass(slots=True)
class Figures:
    """What was found."""

    crowd: Crowd
    ticks: int = 0
    missed: int = 0
    age_p50_ms: float = 0.0
    age_p99_ms: float = 0.0
    age_max_ms: float = 0.0
    snapshots_hz: float = 0.0
    """Received by the median reader of the stream."""

    least_hz: float = 0.0
    """By the one that got fewest."""

    console_hz: float = 0.0
    """Messages of the median console."""

    scene_hz: float = 0.0
    ended: list[str] = field(default_factory=list)
    """Clients that lost their connection, and why."""

    dropped_s: dict[str, float | None] = field(default_factory=dict)
    """After how long each stalled client was dropped, None for never."""

    alone: Cost | None = None
    """Before the crowd came, ..."""

    quarter: Cost | None = None
    end: Cost | None = None
    left: Cost | None = None
    """... and after it had gone."""

    def problems(self) -> list[str]:
        """Return how the bar was missed, in words."""
        found = [f"{who}" for who in self.ended]
        if self.missed:
            found.append(f"{self.missed} ticks were missed")
        if self.age_p99_ms > 1e3 * P99_S:
            found.append(f"the age of snapshots has a p99 of {self.age_p99_ms:.0f} ms")
        if self.crowd.seconds >= 60.0:
            found += [f"{who}: never dropped" for who, s in self.dropped_s.items() if s is None]
            found += self._leaks()
        return found

    def _leaks(self) -> list[str]:
        if self.alone is None or self.quarter is None or self.end is None or self.left is None:
            return []
        found = []
        if self.end.web_mib > (1.0 + GROWTH) * self.quarter.web_mib:
            found.append(
                f"memory grew from {self.quarter.web_mib:.1f} to {self.end.web_mib:.1f} MiB"
            )
        if self.left.handles > self.alone.handles + SLACK_HANDLES:
            found.append(f"{self.left.handles - self.alone.handles} handles were left")
        if self.left.streams > self.alone.streams:
            found.append(f"{self.left.streams - self.alone.streams} streams were left")
        return found

    def as_json(self) -> dict[str, Any]:
        """Return everything as JSON values."""
        return asdict(self)


@dataclass(slots=True)
class _Guests:
    """Those who have come."""

    streams: list[Received] = field(default_factory=list)
    consoles: list[Received] = field(default_factory=list)
    scenes: list[Received] = field(default_factory=list)
    stalled: dict[str, Stalled] = field(default_factory=dict)

    def all_served(self) -> bool:
        """Tell whether everybody has got something, or is gone."""
        everybody = (*self.streams, *self.consoles, *self.scenes)
        return all(got.messages or got.ended for got in everybody)

    def forget(self) -> None:
        """Count from now on."""
        for got in (*self.streams, *self.consoles, *self.scenes):
            got.messages, got.size = 0, 0
            got.ages_s.clear()

    def ended(self) -> list[str]:
        """Return who lost the connection, and why."""
        kinds = {"stream": self.streams, "console": self.consoles, "scene": self.scenes}
        return [f"{kind}: {got.ended}" for kind, all_ in kinds.items() for got in all_ if got.ended]


async def measure(
    scenario: str, crowd: Crowd, folder: Path, options: tuple[str, ...], tell: Tell
) -> Figures:
    """Fly a scenario under a crowd; `options` are those of `falconer run`."""
    figures = Figures(crowd)
    async with flying(scenario, folder, options) as server:
        await asyncio.sleep(min(crowd.settle_s, 3.0))
        figures.alone = await server.cost()
        async with _guests(server, crowd) as guests:
            tell(f"{crowd.streams} streams, {crowd.consoles} consoles, {crowd.scenes} scenes")
            await asyncio.sleep(crowd.settle_s)
            await _watch(server, guests, figures, tell)
        tell("they have gone")
        if crowd.seconds >= 60.0:
            await asyncio.sleep(LEAVE_S)
        figures.left = await server.cost()
    return figures


@asynccontextmanager
async def _guests(server: Server, crowd: Crowd) -> AsyncIterator[_Guests]:
    """Let everybody come, one after the other; they go when the block ends."""
    stream = f"ws://{server.address}/api/v1/missions/{MISSION}/stream"
    scene = f"ws://{server.address}/scene"
    guests, tasks = _Guests(), list[asyncio.Task[None]]()

    async def come(
        kind: list[Received], visit: Callable[[Received], Coroutine[Any, Any, None]]
    ) -> None:
        kind.append(Received())
        tasks.append(asyncio.create_task(visit(kind[-1])))
        await asyncio.sleep(APART_S)

    async with AsyncExitStack() as stack:
        try:
            guests.stalled = {
                "stream": await stalled_stream(stream, HEADERS),
                "console": await stalled_console(server.http, HEADERS),
                "scene": await stalled_scene(scene, HEADERS),
            }
            for stalled in guests.stalled.values():
                stack.callback(stalled.close)
            for _ in range(crowd.streams):
                await come(guests.streams, lambda got: read_stream(stream, HEADERS, got))
            for _ in range(crowd.consoles):
                await come(guests.consoles, lambda got: show_console(server.http, HEADERS, got))
            for _ in range(crowd.scenes):
                await come(guests.scenes, lambda got: show_scene(scene, HEADERS, got))
            async with asyncio.timeout(OPEN_S):
                while not guests.all_served():  # noqa: ASYNC110
                    await asyncio.sleep(APART_S)
            yield guests
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


async def _watch(server: Server, guests: _Guests, figures: Figures, tell: Tell) -> None:
    """Measure for as long as the crowd stays."""
    crowd = figures.crowd
    figures.dropped_s = dict.fromkeys(guests.stalled)
    guests.forget()
    before, began_s = await server.optimizer(), time.monotonic()
    told_s = 0.0
    while (passed_s := time.monotonic() - began_s) < crowd.seconds:
        for who, stalled in guests.stalled.items():
            if figures.dropped_s[who] is None and stalled.dropped():
                figures.dropped_s[who] = round(passed_s + crowd.settle_s, 1)
        if figures.quarter is None and passed_s >= crowd.seconds / 4.0:
            figures.quarter = await server.cost()
        if passed_s - told_s >= 30.0:
            told_s = passed_s
            tell(f"{passed_s:.0f} s: {await server.cost()}")
        await asyncio.sleep(min(LOOK_S, crowd.seconds / 10.0))
    after, flown_s = await server.optimizer(), time.monotonic() - began_s
    figures.end = await server.cost()
    figures.ticks, figures.missed = (
        after["calls"] - before["calls"],
        after["missed"] - before["missed"],
    )
    figures.ended = guests.ended()
    ages_ms = 1e3 * np.concatenate([np.asarray(got.ages_s) for got in guests.streams])
    figures.age_p50_ms, figures.age_p99_ms = (float(p) for p in np.percentile(ages_ms, [50, 99]))
    figures.age_max_ms = float(ages_ms.max())
    rates = np.array([len(got.ages_s) for got in guests.streams]) / flown_s
    figures.snapshots_hz, figures.least_hz = float(np.median(rates)), float(rates.min())
    figures.console_hz = _median_hz(guests.consoles, flown_s)
    figures.scene_hz = _median_hz(guests.scenes, flown_s)


def _median_hz(guests: list[Received], flown_s: float) -> float:
    return float(np.median([got.messages for got in guests])) / flown_s if guests else 0.0
