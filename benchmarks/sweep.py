"""Many runs of one kind: spread over processes, counted by a bar, written as a table."""

import csv
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from server.cli.progress import progress_bar

JobT = TypeVar("JobT")
RunT = TypeVar("RunT")


def swept(fly: Callable[[JobT], RunT], jobs: Sequence[JobT], processes: int) -> list[RunT]:
    """Do all jobs, in order; each process keeps its compiled kernels. One is this one."""
    runs: list[RunT] = []
    with progress_bar("missions", len(jobs)) as progress:

        def note(run: RunT) -> None:
            runs.append(run)
            progress(len(runs))

        if processes == 1:
            for job in jobs:
                note(fly(job))
        else:
            with ProcessPoolExecutor(processes) as pool:
                for run in pool.map(fly, jobs):
                    note(run)
    return runs


def write_csv(path: Path, runs: Sequence[Any]) -> None:
    """Write every run, a dataclass, as one line."""
    records = [asdict(run) for run in runs]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(records[0]))
        writer.writeheader()
        writer.writerows(records)
