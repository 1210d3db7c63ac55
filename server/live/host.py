"""The web side's hold on one child process: start, talk, notice its end, end it.

The child gets its whole configuration by the channel, never by arguments or files. Its standard
input is the life line: when this process goes, however it goes, the child reads end of file and
ends too. It runs in a session of its own, so that Ctrl-C reaches it only through us.
"""

import asyncio
import contextlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from server.live.channel import Caller, ChannelClosed, Json, RequestTimeout
from server.live.outbox import Frame
from server.live.standby import Start, start_process

WORKER = (sys.executable, "-m", "server.live.worker")
START_S = 180.0
"""The child answers its first request within this time: imports, and on the first start of all
the compilation of the optimizer's kernels."""

GRACE_S = 3.0
"""From the end of file to SIGTERM, and again to SIGKILL."""

Receive = Callable[[Frame], None]


class Host(Protocol):
    """Something that runs one mission and answers requests about it."""

    async def run(self, receive: Receive) -> int:
        """Run the mission's process; hand every message to `receive`; return its exit code.

        Cancellation ends the process, and is only over when the process is gone.
        """
        ...

    async def request(
        self, op: str, params: Mapping[str, Any] | None = None, *, timeout_s: float = 5.0
    ) -> Json:
        """Ask the mission. Raises server.live.channel.ChannelError."""
        ...


class ProcessHost:
    """Runs a command that speaks the channel on its standard input and output."""

    def __init__(
        self,
        command: Sequence[str] = WORKER,
        *,
        environment: Mapping[str, str] | None = None,
        grace_s: float = GRACE_S,
        start: Start = start_process,
    ) -> None:
        self._start = start
        self._command = tuple(command)
        self._environment = environment
        self._grace_s = grace_s
        self._caller: Caller | None = None
        self._ready = asyncio.Event()
        self._over = False
        self.pid: int | None = None
        """Process id while it runs."""

    async def run(self, receive: Receive) -> int:
        """Run the process until it ends or this call is cancelled; return the exit code.

        Raises OSError when it cannot be started: then whoever asks it is told so at once.
        """
        try:
            process = await self._start(self._command, self._environment)
        except OSError:
            self._over = True
            self._ready.set()
            raise
        if process.stdin is None or process.stdout is None:
            raise RuntimeError("the process was started without pipes")
        self.pid = process.pid
        self._caller = Caller(process.stdout, process.stdin, receive)
        self._ready.set()
        try:
            await self._caller.run()
            return await process.wait()
        finally:
            self._over = True
            self._ready.set()
            await end_process(process, self._grace_s)
            self.pid = None

    async def request(
        self, op: str, params: Mapping[str, Any] | None = None, *, timeout_s: float = 5.0
    ) -> Json:
        """Ask the process. Raises server.live.channel.ChannelError."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._ready.wait()
        except TimeoutError:
            raise RequestTimeout(f"the mission process did not start in {timeout_s:g} s") from None
        if self._caller is None or self._over:
            raise ChannelClosed("the mission process has ended")
        return await self._caller.request(op, params, timeout_s=timeout_s)


async def end_process(process: asyncio.subprocess.Process, grace_s: float) -> None:
    """End a process and wait until it is gone, however often this call is cancelled meanwhile.

    By end of file, then by SIGTERM, then by SIGKILL.
    """
    ending = asyncio.create_task(_end(process, grace_s))
    cancelled = False
    while not ending.done():
        try:
            await asyncio.shield(ending)
        except asyncio.CancelledError:
            cancelled = True
    ending.result()
    if cancelled:
        raise asyncio.CancelledError


async def _end(process: asyncio.subprocess.Process, grace_s: float) -> None:
    if process.stdin is not None:
        process.stdin.close()
    for signal_process in (process.terminate, process.kill):
        try:
            async with asyncio.timeout(grace_s):
                await process.wait()
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                signal_process()
        else:
            return
    await process.wait()
