"""Journals of the tests: real ones, in files of their own."""

import resource
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from server.journal.database import DatabaseJournal
from server.journal.entry import Entry, EntryKind
from server.journal.store import Store
from server.journal.verification import Verification, verify


def address(folder: Path) -> str:
    return f"sqlite:///{folder / 'journal.db'}"


def event(text: str, number: int = 1, mission: str = "m1") -> Entry:
    return Entry(EntryKind.EVENT, mission, number=number, time_s=1.5, body={"text": text})


def comment(text: str) -> Entry:
    return Entry(EntryKind.COMMENT, "m1", author="operator", body={"id": "c1", "text": text})


@asynccontextmanager
async def journal_at(where: str, max_waiting: int = 1000) -> AsyncIterator[DatabaseJournal]:
    async with DatabaseJournal(Store(where), max_waiting=max_waiting) as journal:
        yield journal


async def verified(where: str) -> Verification:
    store = Store(where)
    await store.open_to_read()
    try:
        return await verify(store)
    finally:
        await store.close()


@contextmanager
def full_disk() -> Iterator[None]:
    """No file of this process can grow: what a full disk does to whoever writes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
