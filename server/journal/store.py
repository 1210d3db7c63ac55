"""The database under the journal: SQLite (WAL) or PostgreSQL, by SQLAlchemy. One writer."""

import asyncio
import fcntl
import hashlib
import os
from collections.abc import AsyncIterator, Iterable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from sqlalchemy import DDL, ColumnElement, Select, delete, event, func, insert, select
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, NoSuchModuleError, SQLAlchemyError
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine, create_async_engine

from server.journal.entry import Head, Sealed
from server.journal.tables import CHECKPOINTS, ENTRIES, METADATA

OPERATION_S: Final = 5.0
"""A database that takes longer for one batch or one page counts as gone."""

LOCK_KEY: Final = 0x46414C43
"""PostgreSQL's advisory lock of the one writer ("FALC")."""

BUSY_S: Final = 2.0
"""How long SQLite waits for another program that holds its lock."""

_DRIVERS: Final = {
    "sqlite": "sqlite+aiosqlite",
    "postgresql": "postgresql+asyncpg",
    "postgres": "postgresql+asyncpg",
}

_NEWEST: Final = select(ENTRIES.c.seq, ENTRIES.c.hash).order_by(ENTRIES.c.seq.desc()).limit(1)

_APPEND_ONLY: Final = "the journal is only ever added to"

_SQLITE_GUARD: Final = (
    "CREATE TRIGGER journal_no_{verb} BEFORE {verb} ON journal "
    "BEGIN SELECT RAISE(ABORT, '{words}'); END"
)
_POSTGRES_REFUSAL: Final = (
    "CREATE OR REPLACE FUNCTION journal_append_only() RETURNS trigger LANGUAGE plpgsql "
    "AS $$ BEGIN RAISE EXCEPTION '{words}'; END $$"
)
_POSTGRES_GUARD: Final = (
    "CREATE TRIGGER journal_append_only BEFORE UPDATE OR DELETE ON journal "
    "FOR EACH STATEMENT EXECUTE FUNCTION journal_append_only()"
)
_GUARDS: Final = {
    "sqlite": (
        _SQLITE_GUARD.format(verb="update", words=_APPEND_ONLY),
        _SQLITE_GUARD.format(verb="delete", words=_APPEND_ONLY),
    ),
    "postgresql": (_POSTGRES_REFUSAL.format(words=_APPEND_ONLY), _POSTGRES_GUARD),
}

for _dialect, _statements in _GUARDS.items():
    for _statement in _statements:
        event.listen(ENTRIES, "after_create", DDL(_statement).execute_if(dialect=_dialect))


class StoreError(Exception):
    """Raised when the database does not do what was asked; says why in words."""


class StoreUrlError(StoreError):
    """Raised when an address is none that a journal can be kept at."""


def parse_url(address: str) -> URL:
    """Return the address with the driver we use. Raises StoreUrlError; tells no password."""
    try:
        url = make_url(address)
    except (ArgumentError, ValueError):
        raise StoreUrlError(
            "expected an address such as sqlite:////var/lib/falconer/journal.db"
            " or postgresql://USER:PASSWORD@HOST/DATABASE"
        ) from None
    driver = _DRIVERS.get(url.get_backend_name())
    if driver is None:
        raise StoreUrlError(
            f"{url.get_backend_name()}: a journal is kept in sqlite or postgresql only"
        )
    if driver.startswith("sqlite") and url.database in (None, "", ":memory:"):
        raise StoreUrlError("a journal in SQLite needs a file: sqlite:////folder/journal.db")
    return url.set(drivername=driver)


class Store:
    """Owner of the connections. Every method raises StoreError when the database is gone."""

    def __init__(self, address: str) -> None:
        self.url = parse_url(address)
        self._engine: AsyncEngine | None = None
        self._writer: AsyncConnection | None = None
        self._lock: int | None = None
        self._inode: tuple[int, int] | None = None

    @property
    def path(self) -> Path | None:
        """The file of a SQLite database, None for PostgreSQL."""
        database = self.url.database
        return Path(database) if self.url.get_backend_name() == "sqlite" and database else None

    @property
    def where(self) -> str:
        """Where it is, without a password."""
        return str(self.path) if self.path else self.url.render_as_string(hide_password=True)

    # ------------------------------------------------------------------ open and close

    async def open(self) -> Head:
        """Connect as the one writer; make what is missing; return the newest entry's place."""
        await self._drop()
        async with self._guard():
            if self.path is not None:
                self._take_file(self.path)
            engine = self._engine = self._make_engine()
            writer = self._writer = await engine.connect()
            if self.path is None:
                taken = await writer.scalar(select(func.pg_try_advisory_lock(LOCK_KEY)))
                if not taken:
                    raise StoreError(_in_use(self.where))
            await writer.run_sync(METADATA.create_all)
            await writer.commit()
            if self.path is not None:
                self._inode = _inode(self.path)
            return await self._head(writer)

    async def open_to_read(self) -> None:
        """Connect without becoming the writer; nothing is made."""
        if self.path is not None and not self.path.is_file():
            raise StoreError(f"{self.where}: there is no journal")
        self._engine = self._make_engine()
        async with self._guard(), self._engine.connect() as connection:
            await connection.execute(select(ENTRIES.c.seq).limit(1))

    async def close(self) -> None:
        """Let go of everything."""
        await self._drop()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    # ------------------------------------------------------------------ write

    async def append(self, batch: Sequence[Sealed], checkpoints: Mapping[str, str]) -> None:
        """Commit entries and checkpoints (mission: JSON text) in one transaction."""
        writer = self._writer
        if writer is None:
            raise StoreError("not connected")
        self._check_file()
        async with self._guard(), writer.begin():
            if batch:
                await writer.execute(insert(ENTRIES), [asdict(sealed) for sealed in batch])
            if checkpoints:
                missions = list(checkpoints)
                await writer.execute(delete(CHECKPOINTS).where(CHECKPOINTS.c.mission.in_(missions)))
                await writer.execute(insert(CHECKPOINTS), _checkpoint_rows(checkpoints))

    # ------------------------------------------------------------------ read

    async def entries(
        self,
        *where: ColumnElement[bool],
        limit: int,
        order: ColumnElement[int] = ENTRIES.c.seq,
    ) -> list[Sealed]:
        """Return the first entries that fit, in the order of a column."""
        query = select(ENTRIES).where(*where).order_by(order).limit(limit)
        return [Sealed(**row) for row in await self._rows(query)]

    async def head(self) -> Head:
        """Return the newest entry's place."""
        rows = await self._rows(_NEWEST)
        return Head(rows[0]["seq"], rows[0]["hash"]) if rows else Head()

    async def checkpoint(self, mission: str) -> tuple[str, str] | None:
        """Return when a checkpoint was kept and what it is, None without a sound one."""
        rows = await self._rows(select(CHECKPOINTS).where(CHECKPOINTS.c.mission == mission))
        sound = [(row["at"], row["body"]) for row in rows if _digest(row["body"]) == row["digest"]]
        return sound[0] if sound else None

    async def damaged_checkpoints(self) -> list[str]:
        """Return the missions whose checkpoint does not fit its digest."""
        rows = await self._rows(select(CHECKPOINTS))
        return [row["mission"] for row in rows if _digest(row["body"]) != row["digest"]]

    async def highest(self, *where: ColumnElement[bool]) -> int:
        """Return the highest number among the entries that fit, 0 for none."""
        rows = await self._rows(select(func.max(ENTRIES.c.number).label("top")).where(*where))
        return int(rows[0]["top"] or 0)

    # ------------------------------------------------------------------ inside

    async def _rows(self, query: Select[Any]) -> list[dict[str, Any]]:
        if self._engine is None:
            raise StoreError("not connected")
        async with self._guard(), self._engine.connect() as connection:
            found = await connection.execute(query)
            return [dict(row) for row in found.mappings()]

    async def _head(self, connection: AsyncConnection) -> Head:
        row = (await connection.execute(_NEWEST)).first()
        await connection.rollback()
        return Head() if row is None else Head(row.seq, row.hash)

    def _make_engine(self) -> AsyncEngine:
        try:
            engine = create_async_engine(self.url, pool_size=2, max_overflow=4, pool_timeout=2.0)
        except (ModuleNotFoundError, NoSuchModuleError) as error:
            raise StoreUrlError(
                f"{error}: PostgreSQL needs the extra: pip install 'falconer[postgres]'"
            ) from error
        if self.path is not None:
            event.listen(engine.sync_engine, "connect", _prepare_sqlite)
        return engine

    def _take_file(self, path: Path) -> None:
        """Make the folder, and lock the file against another server."""
        if self._lock is not None:
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = os.open(path.with_name(path.name + ".lock"), os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            raise StoreError(_in_use(self.where)) from None
        self._lock = lock

    def _check_file(self) -> None:
        """Notice a file that was removed or replaced: SQLite would write on into nowhere."""
        if self.path is not None and _inode(self.path) != self._inode:
            raise StoreError(f"{self.where} has been removed or replaced")

    async def _drop(self) -> None:
        """Close the connections, whatever state they are in."""
        writer, engine = self._writer, self._engine
        self._writer = self._engine = None
        try:
            async with asyncio.timeout(OPERATION_S):
                if writer is not None:
                    await writer.invalidate()
                    await writer.close()
                if engine is not None:
                    await engine.dispose()
        except (SQLAlchemyError, OSError, TimeoutError):
            return  # what cannot be closed in order is left to the system

    @asynccontextmanager
    async def _guard(self) -> AsyncIterator[None]:
        """Turn whatever the database does into StoreError, and give it only so much time."""
        try:
            async with asyncio.timeout(OPERATION_S):
                yield
        except TimeoutError:
            raise StoreError(f"{self.where} does not answer within {OPERATION_S:g} s") from None
        except SQLAlchemyError as error:
            raise StoreError(f"{self.where}: {_words(error)}") from error
        except OSError as error:
            raise StoreError(f"{self.where}: {error.strerror or error}") from error


def _prepare_sqlite(connection: Any, _record: object) -> None:
    """Set what every connection needs: a commit is on the disk when it returns."""
    cursor = connection.cursor()
    for pragma in (
        "journal_mode = WAL",
        "synchronous = FULL",
        f"busy_timeout = {round(1000 * BUSY_S)}",
    ):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _checkpoint_rows(checkpoints: Mapping[str, str]) -> list[dict[str, str]]:
    at = datetime.now(UTC).isoformat(timespec="milliseconds")
    return [
        {"mission": mission, "at": at, "body": body, "digest": _digest(body)}
        for mission, body in checkpoints.items()
    ]


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()


def _inode(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def _in_use(where: str) -> str:
    return f"{where} is in use by another server; give this one another FALCONER_DATABASE_URL"


def _words(error: SQLAlchemyError) -> str:
    """Return what the driver says, without SQLAlchemy's additions and our data."""
    cause = getattr(error, "orig", None) or error
    first: Iterable[str] = str(cause).splitlines() or [type(cause).__name__]
    return next(iter(first)).removeprefix("<class 'asyncpg.exceptions.").strip()
