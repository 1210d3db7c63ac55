"""The product as people start it: how fast in lockstep, how soon in the air, how much memory.

    python -m benchmarks.product [--without-numba] [--seconds S] [FILE.yaml ...]

Every figure is of a process of its own. In lockstep a scenario is flown to its end; what is told
is its result's `wall_s` against the mission's time, and the optimizer's times. Live, the console
and the simulated world are there, and the time runs from the command to the first setpoint; after
some seconds of flight the ticks are told that were missed, and the memory of all processes.

`--without-numba` makes Numba impossible to import in all of them: the engine is then `sqp`.
"""

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from benchmarks.fleet import FALCONER, Fleet, Running, free_port
from server.cli.progress import progress_bar

TOKEN = "operator-of-the-benchmark"
_LOOK_S = 0.02
_PATIENCE_S = 180.0


@dataclass(frozen=True, slots=True)
class Lockstep:
    """One mission flown in virtual time."""

    name: str
    robots: int
    targets: int
    mission_s: float
    wall_s: float
    median_ms: float
    p99_ms: float
    max_ms: float

    @property
    def speed(self) -> float:
        """How many times faster than real time."""
        return self.mission_s / self.wall_s


@dataclass(frozen=True, slots=True)
class Live:
    """One mission flown live."""

    name: str
    first_setpoint_s: float
    """From the command to the first tick that was solved."""

    seconds: float
    ticks: int
    missed: int
    memory_mib: float
    """Proportional set size of all processes."""


def lockstep(scenario: str, extra: tuple[str, ...], settings: Mapping[str, str]) -> Lockstep:
    """Fly a scenario to its end in a process of its own."""
    command = [*FALCONER, "run", scenario, "--lockstep", "--json", *extra]
    done = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, **settings}, check=False
    )
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    result: dict[str, Any] = json.loads(done.stdout)
    times = result["optimizer"]
    return Lockstep(
        name=f"{result['scenario']} {' '.join(extra)}",
        robots=result["robots"],
        targets=result["targets"],
        mission_s=result["steps"] * result["dt"],
        wall_s=result["wall_s"],
        median_ms=times["median_ms"],
        p99_ms=times["p99_ms"],
        max_ms=times["max_ms"],
    )


async def live(scenario: str, seconds: float, settings: Mapping[str, str]) -> Live:
    """Fly a scenario live for so long, nobody advising."""
    port = free_port()
    with tempfile.TemporaryDirectory() as scratch:
        environment = {
            **settings,
            "FALCONER_OPERATOR_TOKEN": TOKEN,
            "FALCONER_DATABASE_URL": f"sqlite:///{scratch}/journal.db",
        }
        began = time.monotonic()
        command = (*FALCONER, "run", scenario, "--llm", "none", "--port", str(port))
        async with (
            Fleet() as fleet,
            httpx.AsyncClient(
                base_url=f"http://127.0.0.1:{port}/api/v1",
                headers={"authorization": f"Bearer {TOKEN}"},
                trust_env=False,
            ) as http,
        ):
            running = await fleet.start("falconer", command, "Falconer on", environment)
            async with asyncio.timeout(_PATIENCE_S):
                before = await _ticks(http)
                while not before[0]:
                    await asyncio.sleep(_LOOK_S)
                    before = await _ticks(http)
            first_s = time.monotonic() - began
            before, since = await _ticks(http), time.monotonic()
            await asyncio.sleep(seconds)
            after, flown_s = await _ticks(http), time.monotonic() - since
            memory = memory_mib(running)
    return Live(scenario, first_s, flown_s, after[0] - before[0], after[1] - before[1], memory)


async def _ticks(http: httpx.AsyncClient) -> tuple[int, int]:
    """Return how many ticks were solved, and how many missed."""
    try:
        answer = await http.get("/missions/m1/snapshot")
    except httpx.TransportError:
        return 0, 0
    if answer.status_code != httpx.codes.OK:
        return 0, 0
    loop = answer.json()["loops"]["optimizer"]
    return loop["calls"], loop["missed"]


def memory_mib(running: Running) -> float:
    """Return the proportional set size of a process and all below it, MiB."""
    parents = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                parents[int(folder.name)] = int(
                    (folder / "stat").read_text().rsplit(")")[1].split()[1]
                )
            except (OSError, IndexError):
                continue
    family = {running.process.pid}
    while len(family) != len(
        family := family | {pid for pid, parent in parents.items() if parent in family}
    ):
        pass
    total_kib = 0
    for pid in family:
        try:
            lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        except OSError:
            continue
        total_kib += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return total_kib / 1024.0


def without_numba(scratch: str) -> dict[str, str]:
    """Return the environment of a machine that has no Numba; a stand-in refuses the import."""
    package = Path(scratch) / "numba"
    package.mkdir()
    (package / "__init__.py").write_text("raise ImportError('no numba on this machine')\n")
    places = [scratch, *filter(None, [os.environ.get("PYTHONPATH")])]
    return {"PYTHONPATH": os.pathsep.join(places), "FALCONER_ENGINE": "sqp"}


def lockstep_table(rows: list[Lockstep]) -> str:
    """Return the figures as Markdown."""
    head = (
        "| mission | robots, targets | mission (s) | took (s) | times real time "
        "| solve: median | p99 | max (ms) |"
    )
    lines = [
        head,
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.name} | {row.robots}, {row.targets} | {row.mission_s:.0f} | {row.wall_s:.2f} "
        f"| {row.speed:.0f} | {row.median_ms:.2f} | {row.p99_ms:.2f} | {row.max_ms:.2f} |"
        for row in rows
    ]
    return "\n".join(lines)


def live_table(rows: list[Live]) -> str:
    """Return the figures as Markdown."""
    lines = [
        "| mission | first setpoint after (s) | flown (s) | ticks | missed | memory (MiB) |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.name} | {row.first_setpoint_s:.1f} | {row.seconds:.0f} | {row.ticks} "
        f"| {row.missed} | {row.memory_mib:.0f} |"
        for row in rows
    ]
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """Fly and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.product")
    parser.add_argument("files", nargs="*", default=["ablation", "hardware", "four-by-eight"])
    parser.add_argument("--without-numba", action="store_true", help="fly with sqp alone")
    parser.add_argument("--seconds", type=float, default=20.0, help="of live flight; 0 for none")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as scratch:
        settings = without_numba(scratch) if options.without_numba else {}
        rows = []
        with progress_bar("missions", len(options.files)) as progress:
            for number, name in enumerate(options.files):
                rows.append(lockstep(name, ("--llm", "none"), settings))
                progress(number + 1)
        sys.stdout.write(lockstep_table(rows) + "\n")
        if options.seconds > 0.0:
            flown = [asyncio.run(live(options.files[0], options.seconds, settings))]
            sys.stdout.write("\n" + live_table(flown) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
