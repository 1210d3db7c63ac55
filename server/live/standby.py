"""Child processes that speak by their pipes; some are started before anybody has work for them.

Planner and world take about a second before they can answer. `falconer run` starts them first and
imports its web side meanwhile; whoever runs a mission takes them over, or starts new ones.
"""

import asyncio
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import Protocol

from server.live.channel import MAX_LINE_BYTES


class Start(Protocol):
    """Something that gives a running child process for a command."""

    async def __call__(
        self, command: Sequence[str], environment: Mapping[str, str] | None = None
    ) -> asyncio.subprocess.Process:
        """Return a process with pipes that nobody else has. Raises OSError."""
        ...


async def start_process(
    command: Sequence[str], environment: Mapping[str, str] | None = None
) -> asyncio.subprocess.Process:
    """Start a command in a session of its own, its standard input and output as pipes.

    Ctrl-C therefore reaches it only through us. Raises OSError.
    """
    return await asyncio.create_subprocess_exec(
        *command,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        env=None if environment is None else dict(environment),
        limit=MAX_LINE_BYTES,
        start_new_session=True,
    )


class Standby:
    """Owner of processes that wait. Satisfies `Start`: calling it takes one over for good."""

    def __init__(self) -> None:
        self._waiting: dict[tuple[str, ...], list[asyncio.subprocess.Process]] = {}

    async def ready(self, command: Sequence[str]) -> asyncio.subprocess.Process:
        """Start a command now, for whoever asks for it later; return it. Raises OSError."""
        process = await start_process(command)
        self._waiting.setdefault(tuple(command), []).append(process)
        return process

    async def __call__(
        self, command: Sequence[str], environment: Mapping[str, str] | None = None
    ) -> asyncio.subprocess.Process:
        """Return a process that waits for this command's work, else a new one. Raises OSError."""
        waiting = self._waiting.get(tuple(command), []) if environment is None else []
        while waiting:
            process = waiting.pop()
            if process.returncode is None:
                return process
        return await start_process(command, environment)

    async def dismiss(self) -> None:
        """End the processes that nobody has taken: they have done nothing that could be lost."""
        left = [process for processes in self._waiting.values() for process in processes]
        self._waiting.clear()
        for process in left:
            if process.returncode is None:
                process.kill()
        await asyncio.gather(*(process.wait() for process in left))


@asynccontextmanager
async def standby(commands: Sequence[Sequence[str]]) -> AsyncIterator[Standby]:
    """Let a process of each command wait for as long as the block runs."""
    waiting = Standby()
    try:
        for command in commands:
            await waiting.ready(command)
        yield waiting
    finally:
        await waiting.dismiss()
