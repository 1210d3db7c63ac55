"""The journal's database, as somebody has it who can take it away."""

import asyncio
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from benchmarks.fleet import FALCONER, ROOT
from tests.chaos.disk import SmallDisk
from tests.server.journal.postgres import Postgres

PATIENCE_S = 120.0
INSIDE = (sys.executable, "-m", "tests.chaos.inside")


class Database(Protocol):
    """Where the journal is kept."""

    @property
    def address(self) -> str:
        """As the server is told it."""
        ...

    def beside(self, command: Sequence[str]) -> tuple[str, ...]:
        """Return the command that runs another one where the database is seen."""
        ...

    async def take_away(self) -> None:
        """Let it be gone."""
        ...

    async def give_back(self) -> None:
        """Let it be there again."""
        ...

    async def close(self) -> None:
        """Remove what no fleet removes."""
        ...


@dataclass
class Lite:
    """A file on a small disk; another program can lock it."""

    disk: SmallDisk
    _locks: list[asyncio.subprocess.Process] = field(default_factory=list)

    @property
    def address(self) -> str:
        """As the server is told it."""
        return f"sqlite:///{self.disk.folder / 'journal.db'}"

    def beside(self, command: Sequence[str]) -> tuple[str, ...]:
        """Return the command that runs another one where the database is seen."""
        return self.disk.command(command)

    async def take_away(self) -> None:
        """Lock it."""
        lock = await asyncio.create_subprocess_exec(
            *self.beside((*INSIDE, "lock", self.address)),
            cwd=ROOT,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
        )
        self._locks.append(lock)
        assert lock.stdout is not None
        async with asyncio.timeout(PATIENCE_S):
            assert await lock.stdout.readline() == b"locked\n"

    async def give_back(self) -> None:
        """Let go of it."""
        while self._locks:
            lock = self._locks.pop()
            assert lock.stdin is not None
            lock.stdin.close()
            async with asyncio.timeout(PATIENCE_S):
                await lock.communicate()

    async def close(self) -> None:
        """Let go of it."""
        await self.give_back()


@dataclass
class Served:
    """A PostgreSQL server, which can be killed."""

    server: Postgres

    @property
    def address(self) -> str:
        """As the server is told it."""
        return self.server.url

    def beside(self, command: Sequence[str]) -> tuple[str, ...]:
        """Return the command that runs another one where the database is seen."""
        return tuple(command)

    async def take_away(self) -> None:
        """End it as if its machine had lost power."""
        await asyncio.to_thread(self.server.stop)

    async def give_back(self) -> None:
        """Start it again."""
        await asyncio.to_thread(self.server.start)

    async def close(self) -> None:
        """End and remove it."""
        await asyncio.to_thread(self.server.remove)


async def served() -> Served:
    """Start a PostgreSQL server."""
    return Served(await asyncio.to_thread(lambda: Postgres().start()))


async def asked(database: Database, act: str, *about: str) -> str:
    """Do something from beside the server; return what it came to."""
    command = database.beside((*INSIDE, act, database.address, *about))
    return (await _said(command, {}))[1].strip()


async def doctor(database: Database) -> tuple[bool, str]:
    """Let the product read the whole journal; return whether it is whole, and its words."""
    command = database.beside((*FALCONER, "doctor", "--journal"))
    code, words = await _said(command, {"FALCONER_DATABASE_URL": database.address}, may_fail=True)
    return code == 0, words.strip()


async def _said(
    command: Sequence[str], environment: dict[str, str], *, may_fail: bool = False
) -> tuple[int, str]:
    process = await asyncio.create_subprocess_exec(
        *command,
        cwd=ROOT,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        env={**os.environ, **environment},
    )
    async with asyncio.timeout(PATIENCE_S):
        words, _ = await process.communicate()
    assert process.returncode is not None
    if process.returncode and not may_fail:
        raise AssertionError(f"{command}: {words.decode()}")
    return process.returncode, words.decode()
