"""An hour in the air: eight robots, sixteen targets, both models' loops, console, recording.

    python -m benchmarks.soak [--seconds 3600] [--scenario FILE] [--json FILE]

`falconer run` flies live with the mock model and records, while a console with its scene is open
and one program reads the stream. Every minute it is noted what the processes hold. Told are the
ticks missed, how evenly snapshots were made (their own stamps against the 10 Hz grid) and how old
they were at their reader, and memory, handles and tasks over time. Exit 1 beyond the bar: a
ten-thousandth of the ticks missed, a p99 of 8 ms off the grid, the memory of all processes beyond
700 MiB or grown, from a quarter of the time on, by more than a thirtieth; handles or tasks grown.
"""

import argparse
import asyncio
import json
import os
import re
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from websockets.asyncio.client import connect

from benchmarks.crowd.clients import Received, show_console, show_scene
from benchmarks.crowd.server import HEADERS, MISSION, Cost, Server, flying
from server.cli.progress import progress_bar

PERIOD_S: Final = 0.1
EARLY_S: Final = 0.003
"""What is more ahead of the punctual ones than this is late by more than half a period."""

NOTE_S: Final = 60.0
ENDLESS: Final = 1_000_000
"""Steps, so that the mission does not end by itself."""

MISSED_SHARE: Final = 1e-4
JITTER_P99_MS: Final = 8.0
MEMORY_MIB: Final = 700.0
GROWTH: Final = 1.0 / 30.0
SLACK_HANDLES: Final = 8
SLACK_TASKS: Final = 16

_STAMP: Final = re.compile(r'"stamp_s": ?([0-9.]+)')
_TICK: Final = re.compile(r'"tick": ?(\d+)')


@dataclass(slots=True)
class Heard:
    """What the reader of the stream noted, one entry per snapshot."""

    ticks: list[int] = field(default_factory=list)
    stamps_s: list[float] = field(default_factory=list)
    ages_s: list[float] = field(default_factory=list)

    async def listen(self, server: Server) -> None:
        """Read until cancelled."""
        url = f"ws://{server.address}/api/v1/missions/{MISSION}/stream"
        async with connect(
            url, additional_headers=HEADERS, compression=None, max_size=None, proxy=None
        ) as stream:
            async for text in stream:
                now_s = time.monotonic()
                assert isinstance(text, str)
                stamp, tick = _STAMP.search(text), _TICK.search(text)
                if stamp is None or tick is None or (self.ticks and int(tick[1]) <= self.ticks[-1]):
                    continue
                self.ticks.append(int(tick[1]))
                self.stamps_s.append(float(stamp[1]))
                self.ages_s.append(now_s - float(stamp[1]))

    def off_grid_ms(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return how far each snapshot was made after its place on the grid, ms.

        The grid is anchored at the most punctual hundredth of each minute, so that the rounding of
        the period does not add up. Whoever is later than a period belongs to the next place: that
        is a missed tick, and counted as such.
        """
        stamps = np.array(self.stamps_s)
        late = stamps % PERIOD_S
        minute = (stamps - stamps[0]) // NOTE_S
        for at in np.unique(minute):
            here = minute == at
            # Turned so that the usual phase lies far from where the remainder wraps around.
            usual = np.median(late[here])
            turned = (late[here] - usual + 0.5 * PERIOD_S) % PERIOD_S
            punctual = np.percentile(turned, 1.0)
            after = turned - punctual
            late[here] = np.where(after < -EARLY_S, after + PERIOD_S, np.maximum(after, 0.0))
        return 1e3 * late


@dataclass(slots=True)
class Soak:
    """What was found."""

    seconds: float
    robots: int
    targets: int
    ticks: int
    missed: int
    off_grid_ms: dict[str, float]
    age_ms: dict[str, float]
    recording_mib: float
    models: dict[str, dict[str, Any]]
    """Both loops' reports at the end."""

    costs: list[tuple[float, Cost]]
    """What the processes held, second by second noted."""

    load: float

    def problems(self) -> list[str]:
        """Return how the bar was missed, in words."""
        found = []
        if self.missed > MISSED_SHARE * self.ticks:
            found.append(f"{self.missed} of {self.ticks} ticks were missed")
        if self.off_grid_ms["p99"] > JITTER_P99_MS:
            found.append(f"jitter has a p99 of {self.off_grid_ms['p99']:.1f} ms")
        settled = [cost for at_s, cost in self.costs if at_s >= 0.25 * self.seconds]
        if not settled:
            return found
        first, last = settled[0], settled[-1]
        if last.memory_mib > MEMORY_MIB:
            found.append(f"{last.memory_mib:.0f} MiB are held")
        if last.memory_mib > (1.0 + GROWTH) * first.memory_mib:
            found.append(f"memory grew from {first.memory_mib:.0f} to {last.memory_mib:.0f} MiB")
        if last.handles > first.handles + SLACK_HANDLES:
            found.append(f"handles grew from {first.handles} to {last.handles}")
        if last.tasks > first.tasks + SLACK_TASKS:
            found.append(f"tasks grew from {first.tasks} to {last.tasks}")
        return found


@asynccontextmanager
async def _company(server: Server, heard: Heard) -> AsyncIterator[list[Received]]:
    """Have the stream read and a console with its scene open until the block ends."""
    console, scene = Received(), Received()
    visits = (
        heard.listen(server),
        show_console(server.http, HEADERS, console),
        show_scene(f"ws://{server.address}/scene", HEADERS, scene),
    )
    tasks = [asyncio.create_task(visit) for visit in visits]
    try:
        yield [console, scene]
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def soak(scenario: str, seconds: float, folder: Path) -> Soak:
    """Fly for so long and tell what was seen."""
    recording, heard = folder / "soak.mcap", Heard()
    options = ("--llm", "mock", "--record", str(recording), "--steps", str(ENDLESS))
    async with flying(scenario, folder, options) as server, _company(server, heard):
        await asyncio.sleep(10.0)
        before, began_s = await server.optimizer(), time.monotonic()
        first, costs = len(heard.ticks), list[tuple[float, Cost]]()
        with progress_bar("in the air", int(seconds)) as progress:
            while (passed_s := time.monotonic() - began_s) < seconds:
                costs.append((passed_s, await server.cost()))
                progress(int(passed_s))
                await asyncio.sleep(min(NOTE_S, max(0.0, seconds - passed_s)))
        after = await server.optimizer()
        costs.append((time.monotonic() - began_s, await server.cost()))
        path = f"/api/v1/missions/{MISSION}/snapshot"
        snapshot = (await server.http.get(path)).raise_for_status().json()
        heard.ticks, heard.stamps_s, heard.ages_s = (
            heard.ticks[first:],
            heard.stamps_s[first:],
            heard.ages_s[first:],
        )
        return Soak(
            seconds=seconds,
            robots=len(snapshot["robots"]),
            targets=len(snapshot["targets"]),
            ticks=after["calls"] - before["calls"] + after["missed"] - before["missed"],
            missed=after["missed"] - before["missed"],
            off_grid_ms=_spread(heard.off_grid_ms()),
            age_ms=_spread(1e3 * np.array(heard.ages_s)),
            recording_mib=recording.stat().st_size / 2**20,
            models={
                name: report for name, report in snapshot["loops"].items() if name != "optimizer"
            },
            costs=costs,
            load=os.getloadavg()[0],
        )


def _spread(values: np.ndarray[Any, np.dtype[np.float64]]) -> dict[str, float]:
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": float(p50), "p99": float(p99), "max": float(values.max())}


def words(found: Soak) -> str:
    """Return the figures as lines."""
    lines = [
        f"{found.robots} robots, {found.targets} targets, {found.seconds:.0f} s",
        f"ticks {found.ticks}, missed {found.missed}",
        "made after their place on the grid (ms): "
        + ", ".join(f"{name} {value:.1f}" for name, value in found.off_grid_ms.items()),
        "age at the reader (ms): "
        + ", ".join(f"{name} {value:.1f}" for name, value in found.age_ms.items()),
        f"recording {found.recording_mib:.0f} MiB",
        *(f"{name}: {report}" for name, report in found.models.items()),
        "after (s), all processes, web, mission (MiB), handles, tasks:",
    ]
    step = max(1, len(found.costs) // 8)
    for at_s, cost in [*found.costs[:-1:step], found.costs[-1]]:
        lines.append(
            f"{at_s:6.0f} {cost.memory_mib:6.0f} {cost.web_mib:6.0f} {cost.mission_mib:6.0f}"
            f" {cost.handles:5d} {cost.tasks:5d}"
        )
    return "\n".join([*lines, f"load {found.load:.1f}"])


def main() -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--scenario", default="benchmarks/scenarios/swarm.yaml")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    with TemporaryDirectory(prefix="falconer-soak-") as folder:
        found = asyncio.run(soak(asked.scenario, asked.seconds, Path(folder)))
    print(words(found))
    if asked.json is not None:
        asked.json.write_text(json.dumps(asdict(found), indent=2))
    problems = found.problems()
    for problem in problems:
        print(f"BEYOND THE BAR: {problem}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
