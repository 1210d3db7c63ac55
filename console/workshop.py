"""What takes its time and is shown to everybody: recordings, forks, experiments.

Kept here once for all browsers. A fork runs for seconds or minutes; who asked may close the page.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import structlog

from server.api.archive import Archive
from server.api.errors import ServiceError
from server.api.laboratory import Laboratory
from server.mission.setup import GateMode

log = structlog.get_logger(__name__)

Json = dict[str, Any]

FORKS_KEPT: Final = 8


@dataclass(frozen=True, slots=True)
class Change:
    """What is to be different in a fork."""

    mission: str
    at_s: float
    llm: str
    gate: GateMode | None
    comment: str


@dataclass(slots=True, eq=False)
class WhatIf:
    """A fork that was asked for, and what came of it."""

    number: int
    change: Change
    by: str
    story: Json | None = None
    """Both stories' figures once it is done."""

    error: str = ""

    @property
    def done(self) -> bool:
        """Whether it is over."""
        return self.story is not None or bool(self.error)


@dataclass(slots=True)
class Workshop:
    """Owner of the forks that were asked for and of the list of recordings seen last."""

    archive: Callable[[], Archive]
    laboratory: Callable[[], Laboratory]
    recordings: list[Json] | None = None
    """As of GET /recordings; None before they were looked at."""

    forks: list[WhatIf] = field(default_factory=list)
    """The newest last."""

    version: int = 0
    """Counts changes."""

    _count: int = 0
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    def look(self) -> None:
        """Look at the folder of recordings again, beside everything else."""
        self._spawn(self._look(), "look at recordings")

    def fork(self, change: Change, by: str) -> WhatIf:
        """Begin a fork; its outcome shows in `forks`."""
        self._count += 1
        made = WhatIf(self._count, change, by)
        self.forks.append(made)
        del self.forks[:-FORKS_KEPT]
        self.version += 1
        self._spawn(self._fork(made), f"fork {made.number}")
        return made

    async def close(self) -> None:
        """End what is under way."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _look(self) -> None:
        self.recordings = await self.archive().recordings()
        self.version += 1

    async def _fork(self, made: WhatIf) -> None:
        change = made.change
        said = [(change.at_s, change.comment)] if change.comment else []
        try:
            made.story = await self.archive().fork(
                change.mission, change.at_s, change.llm, change.gate, None, said
            )
        except ServiceError as error:
            made.error = error.message
        self.version += 1

    def _spawn(self, work: Any, name: str) -> None:
        task = asyncio.create_task(work, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def _ended(self, task: "asyncio.Task[None]") -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("the workshop failed", task=task.get_name(), exc_info=error)
