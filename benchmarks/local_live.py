"""Ticks of a live mission with and without the embedded language model beside it.

    python -m benchmarks.local_live --seconds 120 --rounds 2

Flies the same scenario by turns with nobody and with the model, in the product's own processes,
and prints how many ticks were missed and how late snapshots arrived, beside what the model did
meanwhile. The first seconds of a flight, in which everything is loaded, do not count.
"""

import argparse
import asyncio
import os
import time
from dataclasses import dataclass, replace
from typing import Any

from rich.console import Console
from rich.progress import track

from benchmarks.live import MISSION, Ticks, Watch, live_mission
from server.models import checked_choice
from server.scenarios import library
from server.settings import Settings

WARM_UP_S = 5.0
COUNTED = ("calls", "tries", "valid_first", "valid", "adopted")


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight."""

    llm: str
    ticks: Ticks
    loops: dict[str, dict[str, Any]]
    load: float
    """Of the machine over the last minute, at the end."""


async def flown(scenario: str, llm: str, seconds: float) -> Flight:
    """Fly once; return the figures after the warm-up."""
    chosen, settings, watch = library.load(scenario), Settings(), Watch()
    setup = replace(chosen.mission_setup(settings.engine), steps=1_000_000)
    async with live_mission(setup, chosen.world_setup(), llm, watch, settings) as service:
        await asyncio.sleep(WARM_UP_S)
        from_s = time.monotonic()
        await asyncio.sleep(seconds)
        until_s = time.monotonic()
        await service.stop(MISSION, "benchmark")
        result = await service.result(MISSION)
    loops = {name: result[name] for name in ("task_llm", "action_llm")}
    return Flight(llm, watch.ticks(from_s, until_s), loops, os.getloadavg()[0])


def main() -> None:
    """Fly by turns and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--scenario", default="hardware")
    parser.add_argument("--seconds", type=float, default=120.0, help="Of each flight.")
    parser.add_argument("--rounds", type=int, default=2, help="Flights with and without.")
    parser.add_argument("--llm", default="local", help="Who advises in every second flight.")
    arguments = parser.parse_args()
    checked_choice(arguments.llm)
    order = ["none", arguments.llm] * arguments.rounds
    for llm in track(order, console=Console(stderr=True)):
        _print(asyncio.run(flown(arguments.scenario, llm, arguments.seconds)))


def _print(flight: Flight) -> None:
    ticks = flight.ticks
    late = (ticks.late_p50_ms, ticks.late_p99_ms, ticks.late_max_ms)
    print(
        f"{flight.llm:6} {ticks.ticks} ticks, {ticks.missed} missed ({ticks.missed_share:.3%}), "
        "late p50 {:.1f} p99 {:.1f} max {:.1f} ms, ".format(*late)
        + f"load {flight.load:.1f}"
    )
    for name, loop in flight.loops.items():
        if loop["calls"]:
            counts = ", ".join(f"{key} {loop[key]}" for key in COUNTED)
            print(f"       {name}: {counts}, mean {loop['mean_latency_s']:.1f} s")


if __name__ == "__main__":
    main()
