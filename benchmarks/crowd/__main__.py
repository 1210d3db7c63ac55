"""A live mission under a crowd of clients.

    python -m benchmarks.crowd [--seconds 300] [--streams 50] [--consoles 10] [--scenes 3]
                               [--scenario mixed] [--json FILE]

`falconer run` with its console and the mock model serves readers of the stream and browsers'
consoles, some with the scene, and one of each that stalls. Told are ticks missed, the age of
snapshots at their readers (one clock: from the making of each in the mission's process to its
receipt here), and what the server holds before, meanwhile and after. Exit 1 beyond the bar: no
tick missed, p99 below 150 ms, memory flat, the stalled dropped.
"""

import argparse
import asyncio
import json
import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.crowd.measure import Crowd, Figures, measure


def _words(figures: Figures) -> str:
    """Return the figures as lines."""
    p50, p99, longest = figures.age_p50_ms, figures.age_p99_ms, figures.age_max_ms
    readers, least = figures.snapshots_hz, figures.least_hz
    lines = [
        f"ticks {figures.ticks}, missed {figures.missed}",
        f"age of snapshots (ms): p50 {p50:.1f}, p99 {p99:.1f}, max {longest:.1f}",
        f"messages (Hz): per reader {readers:.2f}, of whom the least {least:.2f}",
        f"messages (Hz): per console {figures.console_hz:.2f}, per scene {figures.scene_hz:.2f}",
        f"stalled and dropped after (s): {figures.dropped_s}",
        f"alone    {figures.alone}",
        f"quarter  {figures.quarter}",
        f"end      {figures.end}",
        f"left     {figures.left}",
        f"load {os.getloadavg()[0]:.1f}",
    ]
    return "\n".join(lines)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = Crowd()
    parser.add_argument("--seconds", type=float, default=known.seconds)
    parser.add_argument("--streams", type=int, default=known.streams)
    parser.add_argument("--consoles", type=int, default=known.consoles)
    parser.add_argument("--scenes", type=int, default=known.scenes)
    parser.add_argument("--scenario", default="mixed")
    parser.add_argument("--llm", default="mock")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    crowd = Crowd(asked.streams, asked.consoles, asked.scenes, asked.seconds)
    with TemporaryDirectory(prefix="falconer-crowd-") as folder:
        figures = asyncio.run(
            measure(
                asked.scenario,
                crowd,
                Path(folder),
                ("--llm", asked.llm),
                lambda words: print(words, file=sys.stderr),
            )
        )
    print(_words(figures))
    if asked.json is not None:
        asked.json.write_text(json.dumps(figures.as_json(), indent=2))
    problems = figures.problems()
    for problem in problems:
        print(f"BEYOND THE BAR: {problem}")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
