"""The seam: what the service asks of a journal, whatever keeps it."""

from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self

from server.journal.entry import Entry, EntryKind, Head, Sealed


class JournalUnavailable(Exception):
    """Raised when an entry could not be committed, or the database cannot be read."""


@dataclass(frozen=True, slots=True)
class JournalStatus:
    """How the journal does."""

    available: bool
    reason: str
    """Why it is not available, in words; else empty."""

    head: Head
    waiting: int
    """Entries that are not committed yet."""

    lost: int
    """Entries for which there was no room while the database was away, or which were no JSON."""


Watcher = Callable[[JournalStatus], None]


class Journal(Protocol):
    """Keeps what happened. Use it as a context; leaving writes what waits."""

    async def __aenter__(self) -> Self:
        """Open it. Raises JournalUnavailable."""
        ...

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write what waits and close it."""
        ...

    @property
    def status(self) -> JournalStatus:
        """How it does now."""
        ...

    def watch(self, watcher: Watcher) -> None:
        """Call `watcher` whenever the journal goes away or comes back."""
        ...

    def post(self, entry: Entry) -> None:
        """Write an entry when there is time. Never waits, never fails."""
        ...

    async def commit(self, entry: Entry) -> Sealed:
        """Write an entry and return once it is durable. Raises JournalUnavailable."""
        ...

    def keep(self, mission: str, checkpoint: str) -> None:
        """Replace a mission's checkpoint (JSON text) when there is time; the newest wins."""
        ...

    async def checkpoint(self, mission: str) -> dict[str, Any] | None:
        """Return a mission's newest checkpoint and the wall clock `at` which it was kept.

        None when no sound one is kept. Raises JournalUnavailable.
        """
        ...

    async def read(
        self, mission: str, kinds: tuple[EntryKind, ...], after: int = 0, limit: int = 1000
    ) -> list[Sealed]:
        """Return a mission's entries of some kinds after a seq, oldest first.

        Raises JournalUnavailable.
        """
        ...

    async def page(self, mission: str, kind: EntryKind, after: int, limit: int) -> list[Sealed]:
        """Return a mission's entries of one kind after a number, oldest first.

        Raises JournalUnavailable.
        """
        ...

    async def missions(self) -> list[Sealed]:
        """Return the entries that made missions, oldest first. Raises JournalUnavailable."""
        ...

    async def last_number(self, mission: str, kind: EntryKind) -> int:
        """Return the highest number of a mission's entries of one kind, 0 for none.

        Raises JournalUnavailable.
        """
        ...
