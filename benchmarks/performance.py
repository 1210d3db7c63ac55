"""All figures of `docs/performance.md`, measured and written there.

    python -m benchmarks.performance [--quick] [--write-docs] [PART ...]

Parts are `engines` (side by side, growth, picture), `core` (one tick of the whole core),
`product` (lockstep speed, first setpoint, memory), `numba-free` (the same with `sqp` alone),
`kernels` (compiling and loading them). All of them by default. `--quick` takes a tenth of the
ticks and leaves out what takes longest; its figures are for looking, not for the document.
"""

import argparse
import asyncio
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks import core, optimizer, product
from benchmarks.report import draw, growth, machine, table
from server.cli.progress import progress_bar
from solver import engines
from solver.problem import Budget

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "performance.md"
PICTURE = DOCUMENT.with_name("pictures") / "engines.svg"
_ITERATIONS = 500
_TICKS = 300
_LIVE_S = 30.0


def engine_figures(quick: bool) -> str:  # noqa: FBT001 (a command-line flag)
    """Return the engines' table and growth; draw the picture."""
    fleet = {name: engines.create(name) for name in engines.names()}
    budget = Budget(iterations=_ITERATIONS)
    rows = []
    chosen = optimizer.cases(quick)
    with progress_bar("engines", len(chosen)) as progress:
        for number, case in enumerate(chosen, start=1):
            rows += optimizer.measure(case, fleet, budget)
            progress(number)
    if not quick:
        draw(PICTURE, rows)
    exponents = [(h, growth(rows, h)) for h in sorted({row.horizon for row in rows})]
    grown = "\n".join(
        f"- `fast`, {horizon} steps: the median grows as robots^{exponent:.2f}"
        for horizon, exponent in exponents
        if exponent is not None
    )
    return f"{table(rows)}\n\n{grown}"


def core_figures(quick: bool) -> str:  # noqa: FBT001 (a command-line flag)
    """Return the table of whole ticks."""
    return core.table(core.ticks(_TICKS // 10 if quick else _TICKS))


def product_figures(quick: bool) -> str:  # noqa: FBT001 (a command-line flag)
    """Return lockstep speed, first setpoint, memory."""
    return _flown({}, ("none", "mock"), quick)


def numba_free_figures(quick: bool) -> str:  # noqa: FBT001 (a command-line flag)
    """Return the same on a machine without Numba."""
    with tempfile.TemporaryDirectory() as scratch:
        return _flown(product.without_numba(scratch), ("none",), quick)


def _flown(settings: dict[str, str], models: tuple[str, ...], quick: bool) -> str:  # noqa: FBT001
    rows = []
    names = ("ablation",) if quick else ("ablation", "hardware", "four-by-eight")
    for name in names:
        for model in models:
            gate = ("--gate", "auto") if model != "none" else ()
            rows.append(product.lockstep(name, ("--llm", model, *gate), settings))
    live = [
        asyncio.run(product.live(name, 5.0 if quick else _LIVE_S, settings))
        for name in (("hardware",) if quick else ("hardware", "demo"))
    ]
    return f"{product.lockstep_table(rows)}\n\n{product.live_table(live)}"


def kernel_figures(quick: bool) -> str:  # noqa: FBT001 (a command-line flag)
    """Return how long the kernels take to compile (not if quick) and to load."""
    code = "from solver.engines.fast.compiled import compiled; compiled()"
    seconds = []
    with tempfile.TemporaryDirectory() as scratch:
        environment = {**os.environ, "FALCONER_CACHE_DIR": scratch}
        for _ in range(0 if quick else 2):
            began = time.monotonic()
            subprocess.run([sys.executable, "-c", code], env=environment, check=True)
            seconds.append(time.monotonic() - began)
    if not seconds:
        return ""
    return (
        f"- compiled by `make setup`, once per installation: {seconds[0]:.0f} s\n"
        f"- loaded by a new process, interpreter and imports included: {seconds[1]:.1f} s"
    )


PARTS: dict[str, Callable[[bool], str]] = {
    "engines": engine_figures,
    "core": core_figures,
    "product": product_figures,
    "numba-free": numba_free_figures,
    "kernels": kernel_figures,
}


def inserted(document: str, part: str, text: str) -> str:
    """Return a document with the text between the part's two markers replaced.

    Raises:
        ValueError: The markers are not there.
    """
    begin, end = f"<!-- {part} -->\n", f"<!-- end of {part} -->"
    if document.count(begin) != 1 or document.count(end) != 1:
        raise ValueError(f"no markers of {part} in the document")
    before, rest = document.split(begin)
    return f"{before}{begin}\n{text}\n\n{end}{rest.split(end)[1]}"


def main(arguments: list[str]) -> int:
    """Measure the parts asked for, print them, write them where asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.performance")
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--quick", action="store_true", help="a tenth of the ticks")
    parser.add_argument("--write-docs", action="store_true", help=f"into {DOCUMENT.name}")
    options = parser.parse_args(arguments)
    unknown = set(options.parts) - set(PARTS)
    if unknown:
        parser.error(f"no part {', '.join(sorted(unknown))}: choose from {', '.join(PARTS)}")
    if options.quick and options.write_docs:
        parser.error("--quick figures are not for the document")
    for part in options.parts or PARTS:
        began, before = time.monotonic(), machine()
        text = PARTS[part](options.quick)
        stamp = f"{before}. {time.strftime('%Y-%m-%d')}, {time.monotonic() - began:.0f} s."
        text = f"{text}\n\n*{stamp}*"
        sys.stdout.write(f"## {part}\n\n{text}\n\n")
        sys.stdout.flush()
        if options.write_docs:
            document = DOCUMENT.read_text(encoding="utf-8")
            DOCUMENT.write_text(inserted(document, part, text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
