"""What inferring zones is worth: the same worlds flown blind, inferring, and with zones revealed.

    python -m benchmarks.discovery unseen --seeds 10 --out discovery

Every scenario is flown in lockstep without any model, once per seed and manner, and all three meet
the same dice. `blind`: nothing is revealed and nothing inferred. `inferred`: nothing is revealed,
and the team learns from failures. `oracle`: the first hit reveals a zone as it is (the paper).
Means with 95 % intervals, and differences per seed to flying blind.
"""

import argparse
import asyncio
import statistics
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.quality import mean_and_half_width
from benchmarks.sweep import swept, write_csv
from server.lockstep.assembly import Assembly
from server.lockstep.job import PAPER_LATENCY
from server.scenarios import library
from server.scenarios.schema import Scenario
from server.settings import Settings
from solver.snapshot import Snapshot
from solver.zones import Zone
from vehicles.world.setup import Discovery
from vehicles.world.world import World

NEAR_M = 1.0
"""An inferred zone whose centre is closer to that of a true one of its kind has found it."""


class Manner(StrEnum):
    """How a team comes to know zones."""

    BLIND = "blind"
    INFERRED = "inferred"
    ORACLE = "oracle"


FIGURES = ("sensing_attacks", "communication_attacks", "accumulated_trace")


@dataclass(frozen=True, slots=True)
class Job:
    """One run to do."""

    scenario: str
    seed: int
    manner: Manner
    steps: int | None = None


@dataclass(frozen=True, slots=True)
class Run:
    """What one run came to."""

    scenario: str
    seed: int
    manner: Manner
    sensing_attacks: int
    communication_attacks: int
    accumulated_trace: float
    zones: int
    """True ones."""

    found: int
    """True ones that the team knew in the end, within `NEAR_M`."""

    false: int
    """Zones known in the end that are none."""


def fly(job: Job) -> Run:
    """Do one run in lockstep."""
    loaded = library.load(job.scenario).varied(seed=job.seed, steps=job.steps)
    reveals = Discovery.ORACLE if job.manner is Manner.ORACLE else Discovery.INFERRED
    scenario = Scenario.model_validate({**loaded.model_dump(), "discovery": reveals})
    setup = scenario.mission_setup()
    if job.manner is Manner.BLIND:
        setup = replace(setup, hazards=None)
    last: list[tuple[tuple[Zone, ...], tuple[Zone, ...]]] = []

    def look(snapshot: Snapshot, world: World) -> None:
        last[:] = [(snapshot.zones, world.truth().zones)]

    assembly = Assembly(setup, scenario.world_setup(), "none", PAPER_LATENCY, Settings())
    result = asyncio.run(assembly.run((), lambda _: None, witness=look))
    ((known, true),) = last
    return Run(
        scenario=Path(job.scenario).stem,
        seed=job.seed,
        manner=job.manner,
        sensing_attacks=result["sensing_attacks"],
        communication_attacks=result["communication_attacks"],
        accumulated_trace=result["accumulated_trace"],
        zones=len(true),
        found=sum(_meets(zone, known) for zone in true),
        false=sum(not _meets(zone, true) for zone in known),
    )


def _meets(zone: Zone, others: Iterable[Zone]) -> bool:
    return any(
        other.kind is zone.kind and np.hypot(*np.subtract(other.mean, zone.mean)) < NEAR_M
        for other in others
    )


def table(runs: list[Run]) -> str:
    """Return the comparison as Markdown."""
    head = (
        "scenario",
        "zones are",
        "sensing hits",
        "communication hits",
        "trace (m²)",
        "found",
        "false",
    )
    lines = [" | ".join(head), " | ".join("---" for _ in head)]
    for scenario in dict.fromkeys(run.scenario for run in runs):
        own = [run for run in runs if run.scenario == scenario]
        blind = {run.seed: run for run in own if run.manner is Manner.BLIND}
        for manner in dict.fromkeys(run.manner for run in own):
            mine = [run for run in own if run.manner is manner]
            found = statistics.fmean(run.found for run in mine)
            false = statistics.fmean(run.false for run in mine)
            cells = [scenario, manner.value, *(_figure(mine, blind, name) for name in FIGURES)]
            cells += [f"{found:.1f} of {mine[0].zones}", f"{false:.1f}"]
            lines.append(" | ".join(cells))
    return "\n".join(f"| {line} |" for line in lines)


def _figure(mine: list[Run], blind: dict[int, Run], name: str) -> str:
    """Return a mean with its interval and, but for the blind ones, the difference per seed."""
    mean, half = mean_and_half_width([float(getattr(run, name)) for run in mine])
    words = f"{mean:.1f} ± {half:.1f}"
    if mine[0].manner is Manner.BLIND or not blind:
        return words
    pairs = [float(getattr(run, name) - getattr(blind[run.seed], name)) for run in mine]
    difference, spread = mean_and_half_width(pairs)
    return f"{words} ({difference:+.1f} ± {spread:.1f})"


def main() -> None:
    """Fly, print, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.discovery", description=__doc__)
    parser.add_argument("scenarios", nargs="+", help="names or files")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--steps", type=int, help="instead of the scenario's")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="writes OUT.csv")
    asked = parser.parse_args()
    jobs = [
        Job(scenario, seed, manner, asked.steps)
        for scenario, seed, manner in product(asked.scenarios, range(asked.seeds), Manner)
    ]
    runs = swept(fly, jobs, asked.jobs)
    print(table(runs))
    if asked.out:
        write_csv(asked.out.with_suffix(".csv"), runs)


if __name__ == "__main__":
    main()
