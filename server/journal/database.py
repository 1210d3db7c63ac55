"""The journal in a database: one task writes, everybody else only leaves entries with it.

While the database is away (disk full, server gone), entries wait in a bounded buffer, and
whoever needs a commit is refused at once. It is tried again and again; when it is back, what
waited is written first. A commit whose answer was lost is recognised by the hash of the newest
entry, so that nothing is written twice.
"""

import asyncio
import contextlib
import json
from collections import deque
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Final, Self

import structlog

from server.journal.entry import Entry, EntryKind, Head, Sealed, seal
from server.journal.journal import JournalStatus, JournalUnavailable, Watcher
from server.journal.store import Store, StoreError
from server.journal.tables import ENTRIES

log = structlog.get_logger(__name__)

MAX_WAITING: Final = 20_000
"""Entries kept while the database is away: some 10 MB, half an hour of a lively mission."""

MAX_BATCH: Final = 500

COMMIT_S: Final = 3.0
"""Whoever needs a commit is refused when it takes longer."""

RETRY_S: Final = (0.2, 0.5, 1.0, 2.0)
"""Pauses between attempts to reach a database that is away; the last one repeats."""

CLOSE_S: Final = 5.0


@dataclass(slots=True, eq=False)
class _Waiting:
    entry: Entry
    answer: asyncio.Future[Sealed] | None
    """Of whoever waits for the commit."""


class DatabaseJournal:
    """Owner of the journal's writer."""

    def __init__(self, store: Store, *, max_waiting: int = MAX_WAITING) -> None:
        self._store = store
        self._max_waiting = max_waiting
        self._queue: deque[_Waiting] = deque()
        self._checkpoints: dict[str, str] = {}
        self._doubtful: list[_Waiting] = []
        self._sealed: list[Sealed] = []
        """The last batch that was tried, and as what; its fate may be unknown."""

        self._head = Head()
        self._connected = False
        self._reason = ""
        self._lost = 0
        self._lost_untold = 0
        self._closing = False
        self._wake = asyncio.Event()
        self._watchers: list[Watcher] = []
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        """Open the database and start the writer. Raises JournalUnavailable."""
        try:
            self._head = await self._store.open()
        except StoreError as error:
            await self._store.close()
            raise JournalUnavailable(f"the journal cannot be opened: {error}") from error
        self._connected = True
        self._task = asyncio.create_task(self._run(), name="journal")
        self.post(Entry(EntryKind.SERVER, body={"did": "started"}))
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write what waits, as far as that is quick, and close."""
        self.post(Entry(EntryKind.SERVER, body={"did": "stopped"}))
        self._closing = True
        self._wake.set()
        if self._task is not None:
            with contextlib.suppress(TimeoutError, asyncio.CancelledError):
                async with asyncio.timeout(CLOSE_S):
                    await self._task
        if self._queue:
            log.error("journal closed with entries unwritten", entries=len(self._queue))
        self._refuse(self._queue, "the server is shutting down")
        await self._store.close()

    @property
    def status(self) -> JournalStatus:
        """How it does now."""
        waiting = len(self._queue) + len(self._doubtful)
        return JournalStatus(not self._reason, self._reason, self._head, waiting, self._lost)

    def watch(self, watcher: Watcher) -> None:
        """Call `watcher` whenever the journal goes away or comes back."""
        self._watchers.append(watcher)

    def post(self, entry: Entry) -> None:
        """Leave an entry to be written."""
        if len(self._queue) >= self._max_waiting:
            self._lose()
            return
        self._queue.append(_Waiting(entry, None))
        self._wake.set()

    async def commit(self, entry: Entry) -> Sealed:
        """Write an entry and return once it is durable. Raises JournalUnavailable."""
        if self._reason or self._closing or self._task is None:
            raise JournalUnavailable(self._reason or "the journal is closed")
        answer: asyncio.Future[Sealed] = asyncio.get_running_loop().create_future()
        self._queue.append(_Waiting(entry, answer))
        self._wake.set()
        try:
            async with asyncio.timeout(COMMIT_S):
                return await answer
        except TimeoutError:
            raise JournalUnavailable(f"no commit within {COMMIT_S:g} s") from None

    def keep(self, mission: str, checkpoint: str) -> None:
        """Replace a mission's checkpoint when there is time."""
        self._checkpoints[mission] = checkpoint
        self._wake.set()

    # ------------------------------------------------------------------ read

    async def checkpoint(self, mission: str) -> dict[str, Any] | None:
        """Return a mission's newest checkpoint and its `at`, if a sound one is kept."""
        with _readable():
            kept = await self._store.checkpoint(mission)
        if kept is None:
            return None
        values: dict[str, Any] = json.loads(kept[1])
        return {**values, "at": kept[0]}

    async def read(
        self, mission: str, kinds: tuple[EntryKind, ...], after: int = 0, limit: int = 1000
    ) -> list[Sealed]:
        """Return a mission's entries of some kinds after a seq, oldest first."""
        c = ENTRIES.c
        with _readable():
            return await self._store.entries(
                c.mission == mission, c.kind.in_([*kinds]), c.seq > after, limit=limit
            )

    async def page(self, mission: str, kind: EntryKind, after: int, limit: int) -> list[Sealed]:
        """Return a mission's entries of one kind after a number, oldest first."""
        c = ENTRIES.c
        fits = (c.mission == mission, c.kind == kind.value, c.number > after)
        with _readable():
            return await self._store.entries(*fits, limit=limit, order=c.number)

    async def missions(self) -> list[Sealed]:
        """Return the entries that made missions, oldest first."""
        with _readable():
            return await self._store.entries(
                ENTRIES.c.kind == EntryKind.MISSION.value, limit=100_000
            )

    async def last_number(self, mission: str, kind: EntryKind) -> int:
        """Return the highest number of a mission's entries of one kind, 0 for none."""
        with _readable():
            return await self._store.highest(
                ENTRIES.c.mission == mission, ENTRIES.c.kind == kind.value
            )

    # ------------------------------------------------------------------ the writer

    async def _run(self) -> None:
        attempts = 0
        while True:
            if not (self._queue or self._checkpoints or self._doubtful):
                if self._closing:
                    return
                self._wake.clear()
                await self._wake.wait()
                continue
            try:
                await self._write()
            except StoreError as error:
                self._go_away(str(error))
                if self._closing:
                    return
                await self._rest(RETRY_S[min(attempts, len(RETRY_S) - 1)])
                attempts += 1
            else:
                attempts = 0
                self._come_back()

    async def _write(self) -> None:
        """Write one batch. Raises StoreError."""
        if not self._connected:
            self._find_place(await self._store.open())
            self._connected = True
        batch, self._doubtful = self._doubtful, []
        if self._lost_untold:
            gap = Entry(EntryKind.GAP, body={"lost": self._lost_untold})
            batch.append(_Waiting(gap, None))
            self._lost_untold = 0
        while self._queue and len(batch) < MAX_BATCH:
            waiting = self._queue.popleft()
            if waiting.answer is None or not waiting.answer.done():  # else its asker has left
                batch.append(waiting)
        checkpoints, self._checkpoints = self._checkpoints, {}
        batch, sealed = self._seal(batch)
        self._sealed = sealed
        try:
            await self._store.append(sealed, checkpoints)
        except StoreError:
            self._refuse(batch, "the journal's database is away")
            self._doubtful = batch
            self._checkpoints = checkpoints | self._checkpoints
            raise
        if sealed:
            self._head = Head(sealed[-1].seq, sealed[-1].hash)
        self._sealed = []
        for waiting, entry in zip(batch, sealed, strict=True):
            if waiting.answer is not None and not waiting.answer.done():
                waiting.answer.set_result(entry)

    def _seal(self, batch: list[_Waiting]) -> tuple[list[_Waiting], list[Sealed]]:
        """Return what can be written, and as what.

        One bad entry must not keep all others waiting: it is told of, and counted as lost.
        """
        good: list[_Waiting] = []
        sealed: list[Sealed] = []
        head = self._head
        for waiting in batch:
            try:
                entry = seal(waiting.entry, head)
            except (TypeError, ValueError, RecursionError) as error:
                known = waiting.entry
                why = f"what was to be written is no JSON: {error}"
                log.error("entry lost", kind=known.kind, mission=known.mission, why=why)
                self._lose()
                self._refuse([waiting], why)
                continue
            good.append(waiting)
            sealed.append(entry)
            head = Head(entry.seq, entry.hash)
        return good, sealed

    def _lose(self) -> None:
        """Count an entry that will not be written; the next batch tells of it."""
        self._lost += 1
        self._lost_untold += 1

    def _find_place(self, found: Head) -> None:
        """Settle, after a reconnect, what became of the last batch and where the chain goes on."""
        if self._sealed and found.hash == self._sealed[-1].hash:
            self._doubtful = []  # it was committed; only the answer was lost
        # Whoever was refused has been told so: what they said is not written after the fact.
        self._doubtful = [w for w in self._doubtful if w.answer is None]
        self._sealed = []
        if found.seq < self._head.seq:
            log.error("journal has lost entries", from_seq=found.seq + 1, to_seq=self._head.seq)
            return  # we go on behind what was lost, so that the gap shows
        self._head = found

    def _go_away(self, reason: str) -> None:
        self._connected = False
        came = not self._reason
        self._reason = reason
        self._refuse([w for w in self._queue if w.answer is not None], reason)
        if came:
            log.error("journal unavailable", reason=reason)
            self._tell()

    def _come_back(self) -> None:
        if self._reason:
            self._reason = ""
            log.warning("journal available again", lost=self._lost)
            self._tell()

    def _tell(self) -> None:
        for watcher in self._watchers:
            watcher(self.status)

    async def _rest(self, pause_s: float) -> None:
        """Pause between attempts; closing cuts it short."""
        loop = asyncio.get_running_loop()
        until_s = loop.time() + pause_s
        while not self._closing and loop.time() < until_s:
            self._wake.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout_at(until_s):
                    await self._wake.wait()

    @staticmethod
    def _refuse(waiting: Any, reason: str) -> None:
        for item in waiting:
            if item.answer is not None and not item.answer.done():
                item.answer.set_exception(JournalUnavailable(reason))
                item.answer.exception()  # looked at, so that asyncio does not warn of it


@contextlib.contextmanager
def _readable() -> Any:
    try:
        yield
    except StoreError as error:
        raise JournalUnavailable(str(error)) from error
