"""How well missions go without any model: figures over seeds, beside the authors' program.

    python -m benchmarks.quality exp2.yaml exp3.yaml --seeds 20 --json quality.json

flies every scenario once per seed in lockstep and prints means with 95 % intervals. For the
authors' own scenarios the figures of their program (`authors_runs.csv`: one row per run, their
weights, their trace accounting, attack seeds 0, 1, ...) and the bar stand beside ours: a trace
lower than theirs by a quarter of the way to the attack-free bound, attacks of either kind not
more than 10 % above theirs, an error of position not above theirs.
"""

import argparse
import csv
import json
import statistics
import sys
from itertools import product
from pathlib import Path
from typing import Any

import yaml
from scipy.stats import t as student

from benchmarks.flights import Job, Run, fly
from benchmarks.sweep import swept, write_csv
from server.scenarios.schema import DEFAULT_WEIGHTS

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

FIGURES = ("trace_authors", "sensing_attacks", "communication_attacks", "position_error_m")
"""What is held against their program."""

_COLUMNS = {"trace_authors": "accumulated_trace"}
"""Names in their file where they differ."""

PROFILES: dict[str, tuple[tuple[str, Any], ...]] = {
    "file": (),
    "falconer": (("weights", DEFAULT_WEIGHTS.model_dump()),),
}
"""Whose weights: the scenario's, or those a scenario gets that names none."""


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
                runs[name].append(float(row[_COLUMNS.get(name, name)]))
    return figures


def bars(scenario: str, theirs: dict[str, list[float]]) -> dict[str, float]:
    """Return the highest mean that meets the bar, per figure."""
    means = {name: statistics.fmean(theirs[name]) for name in FIGURES}
    trace = means["trace_authors"]
    free = ATTACK_FREE.get(scenario, trace)
    return {
        "trace_authors": trace - 0.25 * (trace - free),
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
        for name in ("trace", *FIGURES):
            mean, half = mean_and_half_width([float(getattr(run, name)) for run in own])
            row |= {name: mean, f"{name}_half_width": half}
            if theirs and name in limits:
                row[f"{name}_authors"] = statistics.fmean(theirs[name])
                row[f"{name}_bar"] = limits[name]
                row[f"{name}_met"] = _met(mean, half, limits[name])
        for name in ("trajectory_length_m", "saturated", "turning"):
            row[name] = statistics.fmean(getattr(run, name) for run in own)
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


HEAD = (
    "scenario",
    "trace (theirs, bar)",
    "sensing attacks",
    "communication attacks",
    "error (m)",
    "own trace",
    "path (m)",
    "saturated",
    "turning (m/s)",
    "too close (m)",
)


def table(rows: list[dict[str, object]]) -> str:
    """Return the summary as Markdown; `*` marks a bar met by the mean only, `!` one missed."""
    lines = [" | ".join(HEAD), " | ".join("---" for _ in HEAD)]
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
        cells += [
            f"{row['trace']:.1f} ± {row['trace_half_width']:.1f}",
            f"{row['trajectory_length_m']:.1f}",
            f"{100.0 * row['saturated']:.0f} %",  # type: ignore[operator]
            f"{row['turning']:.2f}",
            "none" if near is None else f"{near:.2f}",
        ]
        lines.append(" | ".join(cells))
    return "\n".join(f"| {line} |" for line in lines)


def _change(text: str) -> tuple[str, Any]:
    path, sign, value = text.partition("=")
    if not (path and sign):
        raise argparse.ArgumentTypeError("expected PATH=VALUE, as in planner.horizon=1")
    return path, yaml.safe_load(value)


def arguments(given: list[str]) -> argparse.Namespace:
    """Return what was asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.quality", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("scenarios", nargs="+", help="names or files")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--profile", choices=PROFILES, default="file", help="whose weights (default: the file's)"
    )
    parser.add_argument(
        "--set",
        type=_change,
        action="append",
        default=[],
        metavar="PATH=VALUE",
        help="another value in every scenario: planner.horizon=1",
    )
    parser.add_argument("--csv", type=Path, help="where to write every run")
    parser.add_argument("--json", type=Path, help="where to write the summary")
    return parser.parse_args(given)


def main(given: list[str]) -> int:
    """Fly, print, write what was asked for."""
    asked = arguments(given)
    changes = (*PROFILES[asked.profile], *asked.set)
    seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
    jobs = [Job(scenario, seed, changes) for scenario, seed in product(asked.scenarios, seeds)]
    runs = swept(fly, jobs, asked.jobs)
    rows = summary(runs)
    sys.stdout.write(table(rows) + "\n")
    if asked.csv:
        write_csv(asked.csv, runs)
    if asked.json:
        asked.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
