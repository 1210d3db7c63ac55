"""A thread of its own for blocking work beside the event loop."""

import asyncio
import contextlib
import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Self, TypeVar

import structlog

log = structlog.get_logger(__name__)

ResultT = TypeVar("ResultT")


class WorkThread:
    """Does one job after another. Use it as a context.

    The thread is a daemon: a job that hangs for ever does not keep the process from ending.

    Args:
        name: Of the thread.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._jobs: SimpleQueue[Callable[[], None] | None] = SimpleQueue()

    def __enter__(self) -> Self:
        threading.Thread(target=self._work, name=self._name, daemon=True).start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._jobs.put(None)

    def submit(self, work: Callable[[], ResultT], deliver: Callable[[ResultT], None]) -> None:
        """Do work in the thread as soon as it is free; deliver its result on the running loop.

        Work that raises delivers nothing and is logged; a loop that is closed by then is not
        minded.
        """
        loop = asyncio.get_running_loop()

        def job() -> None:
            result = work()
            with contextlib.suppress(RuntimeError):  # closed: nobody waits any more
                loop.call_soon_threadsafe(deliver, result)

        self._jobs.put(job)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except Exception:  # the next job must still be done
                log.exception("work failed", thread=self._name)
