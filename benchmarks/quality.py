"""How well missions go without any model: figures over seeds, beside the authors' program.

    python -m benchmarks.quality exp2.yaml exp3.yaml --seeds 20 --out quality

flies every scenario once per seed in lockstep and prints means with 95 % intervals. For the
authors' own scenarios the figures of their program (`authors_runs.csv`: one row per run, their
weights, their trace accounting, attack seeds 0, 1, ...) and the bar stand beside ours: a trace
lower than theirs by a quarter of the way to the attack-free bound, attacks of either kind not
more than 10 % above theirs, an error of position not above theirs.
"""

import argparse
import asyncio
import csv
import json
import statistics
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import combinations, product
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from server.cli.progress import progress_bar
from server.lockstep.driver import Lockstep
from server.mission.core import MissionCore
from server.mission.setup import Compat, MissionSetup
from server.mission.tape import NoTape, TapedCore
from server.scenarios import library
from solver import engines
from solver.directives import Weights
from solver.observations import Link
from solver.planner import Planner
from solver.snapshot import Snapshot
from solver.streams import Streams
from vehicles.world.state import Truth
from vehicles.world.world import World

AUTHORS = Path(__file__).with_name("authors_runs.csv")

ATTACK_FREE = {
    "exp2": 14.4,
    "exp3": 22.8,
    "exp4": 88.1,
    "exp7": 47.4,
    "exp104": 151.8,
    "exp304": 49.5,
}
"""Accumulated trace of the best fixed geometry for the initial assignment, if nothing attacked."""

FIGURES = ("trace", "sensing_attacks", "communication_attacks", "position_error_m")
_ROUNDING_M = 1e-6


@dataclass(frozen=True, slots=True)
class Job:
    """One run to do."""

    scenario: str
    seed: int
    changes: tuple[tuple[str, float], ...] = ()
    """Fields of the planner's setup that are to differ from the scenario's."""

    weights: Weights | None = None
    """Instead of the scenario's."""


@dataclass(frozen=True, slots=True)
class Run:
    """What one run came to."""

    scenario: str
    seed: int
    trace: float
    """Accumulated; by the authors' accounting in their scenarios."""

    sensing_attacks: int
    communication_attacks: int
    trajectory_length_m: float
    position_error_m: float
    closest_m: float | None
    """How near two connected robots came that had been at least `min_dist` apart since both
    were connected; None when they always stayed so."""

    tick_ms: float


class Separations:
    """Watches the distances of connected pairs."""

    def __init__(self, min_dist_m: float) -> None:
        self._min_dist_m = min_dist_m
        self._apart: set[tuple[int, int]] = set()
        self.closest_m = float("inf")

    def look(self, snapshot: Snapshot, truth: Truth) -> None:
        """Take the positions after a move and the links it was planned with."""
        linked = dict(zip(snapshot.robots.ids, snapshot.robots.links, strict=True))
        for first, second in combinations(truth.robots, 2):
            pair = (first.id, second.id)
            if {linked[first.id], linked[second.id]} != {Link.CONNECTED}:
                self._apart.discard(pair)
                continue
            gap_m = float(np.hypot(*np.subtract(first.position, second.position)))
            if gap_m >= self._min_dist_m - _ROUNDING_M:
                self._apart.add(pair)
            elif pair in self._apart:
                self.closest_m = min(self.closest_m, gap_m)


def fly(job: Job) -> Run:
    """Do one run in lockstep, with no model and nothing recorded."""
    scenario = library.load(job.scenario).varied(seed=job.seed)
    setup = _changed(scenario.mission_setup(), job)
    world = World(scenario.world_setup(), Streams(setup.seed))
    planner = Planner(engines.create(setup.planner.engine or engines.default_engine()))
    mission = Lockstep(setup, world, TapedCore(MissionCore(setup), NoTape()), planner, None)
    separations = Separations(setup.planner.min_dist_m)
    result = asyncio.run(mission.run(lambda _: separations.look(mission.snapshot, world.truth())))
    authors = setup.compat is Compat.AUTHORS
    return Run(
        scenario=Path(job.scenario).stem,
        seed=job.seed,
        trace=result["accumulated_trace_authors" if authors else "accumulated_trace"],
        sensing_attacks=result["sensing_attacks"],
        communication_attacks=result["communication_attacks"],
        trajectory_length_m=result["trajectory_length_m"],
        position_error_m=result["position_error_m"],
        closest_m=None if np.isinf(separations.closest_m) else separations.closest_m,
        tick_ms=result["optimizer"]["median_ms"],
    )


def _changed(setup: MissionSetup, job: Job) -> MissionSetup:
    changes = {name: int(v) if name == "horizon" else v for name, v in job.changes}
    planner = replace(setup.planner, **changes)  # type: ignore[arg-type]
    return replace(setup, planner=planner, weights=job.weights or setup.weights)


def flown(jobs: list[Job], processes: int) -> Iterator[Run]:
    """Do all runs, in order; each process keeps its compiled kernels."""
    if processes == 1:
        yield from map(fly, jobs)
        return
    with ProcessPoolExecutor(processes) as pool:
        yield from pool.map(fly, jobs)


def mean_and_half_width(values: list[float]) -> tuple[float, float]:
    """Return the mean and half the width of its 95 % interval (Student's t)."""
    count = len(values)
    if count < 2:
        return statistics.fmean(values), float("nan")
    spread = statistics.stdev(values) / count**0.5
    return statistics.fmean(values), float(student.ppf(0.975, count - 1)) * spread


def authors_figures() -> dict[str, dict[str, list[float]]]:
    """Return the runs of the authors' program: scenario, figure, one value per run."""
    figures: dict[str, dict[str, list[float]]] = {}
    with AUTHORS.open(encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            runs = figures.setdefault(row["scenario"], {name: [] for name in FIGURES})
            for name in FIGURES:
                runs[name].append(float(row["accumulated_trace" if name == "trace" else name]))
    return figures


def bars(scenario: str, theirs: dict[str, list[float]]) -> dict[str, float]:
    """Return the highest mean that meets the bar, per figure."""
    means = {name: statistics.fmean(theirs[name]) for name in FIGURES}
    free = ATTACK_FREE.get(scenario, means["trace"])
    return {
        "trace": means["trace"] - 0.25 * (means["trace"] - free),
        "sensing_attacks": 1.1 * means["sensing_attacks"],
        "communication_attacks": 1.1 * means["communication_attacks"],
        "position_error_m": means["position_error_m"],
    }


def summary(runs: list[Run]) -> list[dict[str, object]]:
    """Return one row per scenario, figures beside the authors' where there are any."""
    authors = authors_figures()
    rows: list[dict[str, object]] = []
    for scenario in dict.fromkeys(run.scenario for run in runs):
        own = [run for run in runs if run.scenario == scenario]
        theirs = authors.get(scenario)
        limits = bars(scenario, theirs) if theirs else {}
        row: dict[str, object] = {"scenario": scenario, "seeds": len(own)}
        for name in FIGURES:
            mean, half = mean_and_half_width([float(getattr(run, name)) for run in own])
            row |= {name: mean, f"{name}_half_width": half}
            if theirs:
                row[f"{name}_authors"] = statistics.fmean(theirs[name])
                row[f"{name}_bar"] = limits[name]
                row[f"{name}_met"] = _met(mean, half, limits[name])
        row["trajectory_length_m"] = statistics.fmean(run.trajectory_length_m for run in own)
        near = [run.closest_m for run in own if run.closest_m is not None]
        row["closest_m"] = min(near, default=None)
        row["tick_ms"] = statistics.median(run.tick_ms for run in own)
        rows.append(row)
    return rows


def _met(mean: float, half: float, bar: float) -> str:
    """Return whether a bar is met: at the interval's upper end, by the mean only, or not."""
    if mean + half <= bar:
        return "yes"
    return "mean" if mean <= bar else "no"


def table(rows: list[dict[str, object]]) -> str:
    """Return the summary as Markdown; `*` marks a bar met by the mean only, `!` one missed."""
    head = (
        "scenario",
        "trace",
        "sensing",
        "communication",
        "error (m)",
        "path (m)",
        "too close (m)",
    )
    lines = [" | ".join(head), " | ".join("---" for _ in head)]
    for row in rows:
        cells = [str(row["scenario"])]
        for name in FIGURES:
            digits = 3 if name == "position_error_m" else 1
            cell = f"{row[name]:.{digits}f} ± {row[f'{name}_half_width']:.{digits}f}"
            if f"{name}_bar" in row:
                mark = {"yes": "", "mean": " *", "no": " !"}[str(row[f"{name}_met"])]
                theirs, bar = row[f"{name}_authors"], row[f"{name}_bar"]
                cell += f"{mark} ({theirs:.{digits}f}, bar {bar:.{digits}f})"
            cells.append(cell)
        near = row["closest_m"]
        cells += [f"{row['trajectory_length_m']:.1f}", "none" if near is None else f"{near:.2f}"]
        lines.append(" | ".join(cells))
    return "\n".join(f"| {line} |" for line in lines)


def write(out: Path, runs: list[Run], rows: list[dict[str, object]]) -> None:
    """Write every run as CSV and the summary as JSON."""
    records = [asdict(run) for run in runs]
    with out.with_suffix(".csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(records[0]))
        writer.writeheader()
        writer.writerows(records)
    out.with_suffix(".json").write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


def _weights(text: str) -> Weights:
    return Weights(*map(float, text.split(",")))


def _change(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    return name, float(value)


def main() -> None:
    """Fly, print, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.quality", description=__doc__)
    parser.add_argument("scenarios", nargs="+", help="names or files")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="writes OUT.csv and OUT.json")
    parser.add_argument(
        "--set", type=_change, action="append", default=[], help="planner field: horizon=1"
    )
    parser.add_argument(
        "--weights", type=_weights, help="tracking,control,sensing,communication for all scenarios"
    )
    asked = parser.parse_args()
    jobs = [
        Job(scenario, seed, tuple(asked.set), asked.weights)
        for scenario, seed in product(asked.scenarios, range(asked.seeds))
    ]
    runs: list[Run] = []
    with progress_bar("missions", len(jobs)) as progress:
        for run in flown(jobs, asked.jobs):
            runs.append(run)
            progress(len(runs))
    rows = summary(runs)
    print(table(rows))
    if asked.out:
        write(asked.out, runs, rows)


if __name__ == "__main__":
    main()
