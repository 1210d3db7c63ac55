"""Missions in lockstep: they wait for one of a few processes, in the order they were started."""

import asyncio
import os

import structlog

from server.api.errors import ServiceError
from server.api.processes import Processes
from server.api.record import MissionRecord
from server.encoding import MissionState

log = structlog.get_logger(__name__)


def slots() -> int:
    """Return how many run at once: all processors but one, which is for the live mission."""
    return max(1, len(os.sched_getaffinity(0)) - 1)


class LockstepQueue:
    """Owner of the slots. Use `close` to end what waits."""

    def __init__(self, processes: Processes, free: int) -> None:
        self._processes = processes
        self._slots = asyncio.Semaphore(free)
        self._tasks: set[asyncio.Task[None]] = set()

    def enter(self, record: MissionRecord, author: str) -> None:
        """Let a mission wait for its turn; what happens to it shows in its state."""
        record.change_state(MissionState.QUEUED, author=author)
        task = asyncio.create_task(self._take_turn(record), name=f"queue {record.id}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def close(self) -> None:
        """Let nobody wait any longer."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _take_turn(self, record: MissionRecord) -> None:
        async with self._slots:
            async with record.change:
                if record.state is not MissionState.QUEUED:
                    return  # it was stopped, or removed, meanwhile
                try:
                    await self._processes.launch(record)
                except ServiceError as error:
                    log.warning(
                        "mission in lockstep not started", mission=record.id, why=str(error)
                    )
                    return
            if record.tasks:
                await asyncio.wait(record.tasks)
