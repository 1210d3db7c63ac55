"""Experiments started over HTTP: each is `falconer experiment` in a process of its own.

One runs at a time, the others wait in order. Its folder of results lies beside the journal, so
that what was done before a restart is not done again when it is asked for once more.
"""

import asyncio
import contextlib
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final

import structlog
import yaml

from server.api.errors import ServiceError
from server.live.host import end_process
from server.live.priority import give_way

log = structlog.get_logger(__name__)

COMMAND: Final = (sys.executable, "-m", "server.cli", "experiment")

MAX_EXPERIMENTS: Final = 50
GRACE_S: Final = 5.0
LOOK_S: Final = 0.5
"""Between two looks at how many runs are on disk."""

LONGEST_ERROR: Final = 500


class Progress(StrEnum):
    """How far an experiment is."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    STOPPED = "stopped"


_OVER: Final = frozenset({Progress.DONE, Progress.FAILED, Progress.STOPPED})


@dataclass(frozen=True, slots=True)
class Campaign:
    """What is to be done."""

    kind: str
    arguments: tuple[str, ...]
    """Of the command line, without scenario and folder."""

    runs: int
    scenario: str | dict[str, Any] | None = None
    """A name or a whole one; None where the kind makes its own."""


@dataclass(slots=True, eq=False)
class Experiment:
    """One campaign and how far it is."""

    id: str
    kind: str
    arguments: tuple[str, ...]
    """Of the command line, without the folder."""

    runs: int
    author: str
    folder: Path
    created_at: datetime = field(default_factory=lambda: datetime.now(UTC))
    state: Progress = Progress.QUEUED
    result: dict[str, Any] | None = None
    error: str = ""
    done: int = 0
    """How many of its runs are on disk; a flight in real time is one run."""


class Laboratory:
    """Owner of the experiments. `close` ends them; what was done stays on disk."""

    def __init__(self, folder: Path, command: Sequence[str] = COMMAND) -> None:
        self._folder = folder
        self._command = tuple(command)
        self._known: dict[str, Experiment] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        """Those that conduct what is not over."""

        self._count = 0
        self._bench = asyncio.Semaphore(1)

    def all(self) -> list[Experiment]:
        """Return every experiment, oldest first."""
        return list(self._known.values())

    def one(self, experiment_id: str) -> Experiment:
        """Return one experiment. Raises ServiceError 404."""
        found = self._known.get(experiment_id)
        if found is None:
            raise ServiceError(
                "experiment_unknown",
                f"There is no experiment {experiment_id}.",
                HTTPStatus.NOT_FOUND,
            )
        return found

    def begin(self, campaign: Campaign, author: str) -> Experiment:
        """Let an experiment wait for its turn; what becomes of it, its state tells.

        Raises ServiceError 409.
        """
        if len(self._known) >= MAX_EXPERIMENTS:
            over = next((e for e in self._known.values() if e.state in _OVER), None)
            if over is None:
                raise ServiceError(
                    "too_many_experiments",
                    f"{MAX_EXPERIMENTS} experiments wait already.",
                    HTTPStatus.CONFLICT,
                )
            del self._known[over.id]
        self._count += 1
        name = f"e{self._count}"
        stamp = f"{datetime.now(UTC):%Y%m%dT%H%M%S}"
        kind = campaign.kind
        folder = self._folder / f"{kind}-{stamp}-{name}"
        made = Experiment(name, kind, campaign.arguments, campaign.runs, author, folder)
        self._known[name] = made
        conducting = self._conduct(made, campaign.scenario)
        task = self._tasks[name] = asyncio.create_task(conducting, name=f"experiment {name}")
        task.add_done_callback(lambda _: self._tasks.pop(name, None))
        log.info("experiment begun", experiment=name, author=author, runs=made.runs)
        return made

    async def stop(self, experiment_id: str) -> Experiment:
        """End an experiment; one that is over stays as it is. Raises ServiceError 404."""
        found = self.one(experiment_id)
        task = self._tasks.get(experiment_id)
        if task is not None:
            task.cancel()
            await asyncio.wait({task})
        if found.state not in _OVER:
            found.state = Progress.STOPPED
        return found

    async def close(self) -> None:
        """End all of them; none of those that wait is begun meanwhile."""
        for task in self._tasks.values():
            task.cancel()
        for found in self.all():
            await self.stop(found.id)

    async def _conduct(self, made: Experiment, scenario: str | dict[str, Any] | None) -> None:
        """Let an experiment have its turn; whatever ends it, its state says so."""
        try:
            async with self._bench:
                made.state = Progress.RUNNING
                if scenario is not None:
                    chosen = await asyncio.to_thread(_scenario_file, made.folder, scenario)
                    made.arguments = (*made.arguments, "--scenario", chosen)
                code, printed, said = await self._run(made)
        except (OSError, ValueError) as error:  # the disk, or an argument that no process takes
            _fail(made, str(error))
        else:
            _finish(made, code, printed, said)

    async def _run(self, made: Experiment) -> tuple[int, bytes, bytes]:
        """Run the command to its end; return its exit code and what it printed and said."""
        process = await asyncio.create_subprocess_exec(
            *(*self._command, made.kind, *made.arguments),
            *("--out", str(made.folder), "--json"),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,
            env=_environment(),
        )
        give_way(process.pid)
        counting = asyncio.create_task(_count_runs(made))
        try:
            printed, said = await process.communicate()
            made.done = await asyncio.to_thread(_runs_in, made)
        finally:
            counting.cancel()
            if process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    process.terminate()
                await end_process(process, GRACE_S)
        return process.returncode or 0, printed, said


def _finish(made: Experiment, code: int, printed: bytes, said: bytes) -> None:
    try:
        made.result = json.loads(printed)
    except ValueError:
        made.result = None
    if made.result is not None and code == 0:
        made.state, made.done = Progress.DONE, made.runs
        return
    words = said.decode("utf-8", "replace").strip().splitlines() or [f"exit code {code}"]
    _fail(made, words[-1].removeprefix("falconer: "))


def _fail(made: Experiment, why: str) -> None:
    made.state, made.error = Progress.FAILED, why[:LONGEST_ERROR]
    log.warning("experiment failed", experiment=made.id, why=made.error)


async def _count_runs(made: Experiment) -> None:
    """Count the runs on disk until cancelled."""
    while True:
        made.done = await asyncio.to_thread(_runs_in, made)
        await asyncio.sleep(LOOK_S)


def _runs_in(made: Experiment) -> int:
    return min(made.runs, sum(1 for _ in (made.folder / "runs").glob("*.json")))


def _environment() -> dict[str, str]:
    """Return the settings of experiments: they fly on a bus of their own and record nothing."""
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("FALCONER_ZENOH_", "FALCONER_RECORDINGS"))
    }


def _scenario_file(folder: Path, scenario: str | dict[str, Any]) -> str:
    """Return what the command line is told: a name, or a file made of an object."""
    folder.mkdir(parents=True, exist_ok=True)
    if isinstance(scenario, str):
        return scenario
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(scenario, allow_unicode=True), "utf-8")
    return str(path)
