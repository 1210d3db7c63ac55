"""Does the trials of an experiment in worker processes (joblib), kept ones left alone.

Each worker has one thread for numerics. A trial that fails is told of and costs no other one.
Interrupted, the workers end at once and what was finished is on disk.
"""

import os
import signal
import socket
import threading
import time
import traceback
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Any
from urllib.parse import urlsplit

import joblib
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import TerminatedWorkerError

from server.errors import BadInput
from server.experiments.store import TrialStore
from server.experiments.trials import Trial

REACH_S = 5.0
"""A scheduler answers the door within this time."""

WATCH_S = 0.5
"""How often a worker looks whether its parent still lives."""

ORPHANED = 70
"""Exit code of a worker whose parent is gone."""

_LONGEST_ERROR = 500


class WorkersUnavailable(BadInput):
    """Raised when the workers cannot be had or have gone."""


@dataclass(frozen=True, slots=True)
class Workers:
    """Who does the trials."""

    jobs: int = 1
    """Processes on this machine."""

    scheduler: str | None = None
    """Address of a Dask scheduler, whose workers do the trials instead."""


@dataclass(frozen=True, slots=True)
class Done:
    """A trial with its figures."""

    trial: Trial
    result: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Failed:
    """A trial that raised."""

    trial: Trial
    error: str
    """The exception in one line."""

    details: str
    """Its traceback."""


Outcome = Done | Failed


def outcomes(
    trials: Iterable[Trial], store: TrialStore, workers: Workers
) -> Generator[Outcome, None, None]:
    """Yield every trial's outcome as it is known: kept ones first, the others as they end.

    Each result is on disk before it is yielded. Close the iterator to end the workers.

    Raises:
        StoreError: A result cannot be kept.
        WorkersUnavailable: There is no such scheduler, or the workers were killed.
    """
    waiting: list[Trial] = []
    for trial in trials:
        kept = store.load(trial)
        if kept is None:
            waiting.append(trial)
        else:
            yield Done(trial, kept)
    for outcome in _performed(waiting, workers):
        if isinstance(outcome, Done):
            store.save(outcome.trial, outcome.result)
        yield outcome


def _performed(trials: list[Trial], workers: Workers) -> Iterator[Outcome]:
    if not trials:
        return
    if workers.scheduler is None and (workers.jobs == 1 or len(trials) == 1):
        yield from map(perform, trials)
        return
    try:
        with _backend(workers, len(trials)) as parallel:
            with nullcontext() if workers.scheduler else _out_of_earshot():
                begun = parallel(joblib.delayed(perform)(trial) for trial in trials)
            yield from begun
    except (TerminatedWorkerError, ImportError, OSError, ValueError) as error:
        raise WorkersUnavailable(f"the workers cannot go on: {error}") from error


@contextmanager
def _backend(workers: Workers, count: int) -> Iterator[joblib.Parallel]:
    """Open the workers; whatever ends the block ends those of this machine with it."""
    options = {"return_as": "generator_unordered", "batch_size": 1}
    if workers.scheduler is not None:
        _reach(workers.scheduler)
        with joblib.parallel_config(backend="dask", scheduler_host=workers.scheduler):
            yield joblib.Parallel(**options)
        return
    jobs = min(workers.jobs, count)
    with joblib.parallel_config(
        backend="loky", n_jobs=jobs, inner_max_num_threads=1, initializer=_begin_worker
    ):
        try:
            yield joblib.Parallel(**options)
        finally:
            get_reusable_executor(reuse=True, kill_workers=True).shutdown(kill_workers=True)


def _reach(scheduler: str) -> None:
    """Knock at a scheduler's door: the cluster's own client waits far longer for nobody.

    Raises WorkersUnavailable.
    """
    address = urlsplit(scheduler if "://" in scheduler else f"tcp://{scheduler}")
    words = f"there is no Dask scheduler at {scheduler}"
    try:
        host, port = address.hostname, address.port
    except ValueError as error:
        raise WorkersUnavailable(f"{words}: {error}") from error
    if not host or port is None:
        raise WorkersUnavailable(f"{words}: expected tcp://HOST:PORT")
    try:
        socket.create_connection((host, port), timeout=REACH_S).close()
    except OSError as error:
        raise WorkersUnavailable(f"{words}: {error.strerror or error}") from error


@contextmanager
def _out_of_earshot() -> Iterator[None]:
    """Keep Ctrl-C from processes that are begun meanwhile: they hear it in `_begin_worker`.

    One that was still importing would end with a traceback. We ourselves hear it afterwards.
    """
    resource_tracker.ensure_running()  # begun meanwhile, Python's own would lift the mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker() -> None:
    """Leave Ctrl-C to the parent, which ends its workers, and end when the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_outlive_nobody, args=(os.getppid(),), daemon=True).start()


def _outlive_nobody(parent: int) -> None:
    """End this process once its parent has been killed: nobody would fetch its results."""
    while os.getppid() == parent:
        time.sleep(WATCH_S)
    os._exit(ORPHANED)


def perform(trial: Trial) -> Outcome:
    """Do one trial; what it raises becomes its outcome."""
    try:
        return Done(trial, trial.perform())
    except Exception as error:  # noqa: BLE001 - whatever one trial does, the others go on
        words = f"{type(error).__name__}: {error}".replace("\n", " ")
        return Failed(trial, words[:_LONGEST_ERROR], traceback.format_exc())
