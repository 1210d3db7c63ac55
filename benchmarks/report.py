"""Measurements as a table, as JSON, as a picture, and what they break."""

import json
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

_COLOURS = {"fast": "#0b6e4f", "sqp": "#c77d0a", "ipopt": "#8c2f39"}
_STYLES = {1: "-", 5: "--", 10: ":"}


@dataclass(frozen=True, slots=True)
class Row:
    """One engine on one case. Times in milliseconds of thread CPU time."""

    engine: str
    robots: int
    targets: int
    horizon: int
    dynamics: str
    solves: int
    median_ms: float
    p95_ms: float
    p99_ms: float
    max_ms: float
    converged: float
    """Share of the solves that converged within the budget."""

    gap_median: float | None
    gap_p99: float | None
    """Relative gap of the exact objective to the best of eight starts of ipopt."""

    within: float | None
    """Share of the gaps up to 3e-4."""

    @property
    def case(self) -> tuple[int, int, int, str]:
        """Return what rows must share to be compared."""
        return self.robots, self.targets, self.horizon, self.dynamics


def machine() -> str:
    """Return a line that says what this was measured on."""
    load = os.getloadavg()[0]
    return (
        f"{_processor()}, {os.cpu_count()} processors (load {load:.1f}), "
        f"Python {platform.python_version()}, "
        + ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "casadi"))
    )


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def table(rows: Sequence[Row]) -> str:
    """Return the rows as a Markdown table, each with its ratio to `fast`."""
    fastest = {row.case: row for row in rows if row.engine == "fast"}
    head = (
        "| robots, targets | steps | motion | engine | median | p95 | p99 | max (ms) "
        "| to fast: median, p99 | converged | gap median, p99 | within 3e-4 |"
    )
    lines = [
        head,
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        base = fastest[row.case]
        ratio = f"{row.median_ms / base.median_ms:.0f}, {row.p99_ms / base.p99_ms:.0f}"
        gaps = "" if row.gap_median is None else f"{row.gap_median:.1e}, {row.gap_p99:.1e}"
        within = "" if row.within is None else f"{100.0 * row.within:.0f} %"
        times = (row.median_ms, row.p95_ms, row.p99_ms, row.max_ms)
        lines.append(
            f"| {row.robots}, {row.targets} | {row.horizon} | {row.dynamics.split('_')[0]} "
            f"| {row.engine} | {' | '.join(_figure(value) for value in times)} "
            f"| {'' if row.engine == 'fast' else ratio} | {100.0 * row.converged:.0f} % "
            f"| {gaps} | {within} |"
        )
    return "\n".join(lines)


def _figure(milliseconds: float) -> str:
    return f"{milliseconds:.2f}" if milliseconds < 10.0 else f"{milliseconds:.0f}"


def growth(rows: Sequence[Row], horizon: int, least: int = 8) -> float | None:
    """Return the exponent of the fast engine's median time in the number of robots."""
    chosen = [
        (row.robots, row.median_ms)
        for row in rows
        if row.engine == "fast"
        and row.horizon == horizon
        and row.robots >= least
        and row.dynamics == "single_integrator"
    ]
    if len(chosen) < 3:
        return None
    sizes, times = np.log(np.array(chosen)).T
    return float(np.polyfit(sizes, times, 1)[0])


def write_json(path: Path, rows: Sequence[Row]) -> None:
    """Write all figures."""
    path.parent.mkdir(parents=True, exist_ok=True)
    document = {"machine": machine(), "rows": [asdict(row) for row in rows]}
    path.write_text(json.dumps(document, indent=1) + "\n")


def verdict(figures: Mapping[str, Any], broken: Sequence[str]) -> int:
    """Print figures as JSON and what they break, in words; return the program's exit code."""
    print(json.dumps(figures, indent=2))
    for words in broken:
        print(f"BROKEN: {words}", file=sys.stderr)
    return 1 if broken else 0


def draw(path: Path, rows: Sequence[Row]) -> None:
    """Draw median times over team size, engines by colour, horizons by line (SVG)."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "falconer"
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7.5, 4.6), layout="constrained")
    single = [row for row in rows if row.dynamics == "single_integrator"]
    for engine, colour in _COLOURS.items():
        for horizon, style in _STYLES.items():
            chosen = [r for r in single if r.engine == engine and r.horizon == horizon]
            if chosen:
                sizes = [row.robots for row in chosen]
                axes.plot(
                    sizes,
                    [row.median_ms for row in chosen],
                    style,
                    color=colour,
                    marker="o",
                    markersize=3.5,
                    label=f"{engine}, {horizon} step{'s' if horizon > 1 else ''}",
                )
                if engine == "fast":
                    tails = [row.p99_ms for row in chosen]
                    axes.fill_between(
                        sizes, [r.median_ms for r in chosen], tails, color=colour, alpha=0.08
                    )
    axes.axhline(40.0, color="#777777", linewidth=0.8)
    axes.annotate("deadline 40 ms", (2.0, 44.0), fontsize=8, color="#555555")
    axes.set(xscale="log", yscale="log", xlabel="robots (twice as many targets)")
    axes.set_ylabel("one solve, ms of CPU (median; shaded to p99)")
    axes.grid(visible=True, which="major", linewidth=0.3)
    axes.legend(fontsize=8, ncols=2)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
