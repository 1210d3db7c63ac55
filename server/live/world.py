"""The web side's hold on a simulated world's process (vehicles.sim_worker)."""

import asyncio
import json
import sys
from collections.abc import Mapping, Sequence
from typing import Any, Final

from server.live.channel import ChannelClosed, Json, RequestTimeout
from server.live.host import GRACE_S, Receive, end_process
from server.live.standby import Start, start_process

COMMAND: Final[tuple[str, ...]] = (sys.executable, "-m", "vehicles.sim_worker", "--until-eof")


class WorldHost:
    """Runs a simulated world. Its one request is `start`; then it lives until it is ended."""

    def __init__(
        self,
        command: Sequence[str] = COMMAND,
        *,
        grace_s: float = GRACE_S,
        start: Start = start_process,
    ) -> None:
        self._command = tuple(command)
        self._start = start
        self._grace_s = grace_s
        loop = asyncio.get_running_loop()
        self._job: asyncio.Future[bytes] = loop.create_future()
        self._ready: asyncio.Future[None] = loop.create_future()
        self.pid: int | None = None
        """Process id while it runs."""

    async def run(self, receive: Receive) -> int:
        """Run the world until it ends or this call is cancelled; return the exit code."""
        try:
            process = await self._start(self._command)
        except OSError:
            self._ready.set_exception(ChannelClosed("the simulated world cannot be started"))
            self._ready.exception()  # nobody may be waiting for it
            raise
        if process.stdin is None or process.stdout is None:
            raise RuntimeError("the process was started without pipes")
        self.pid = process.pid
        try:
            # It imports while the planner prepares, and only then is told where the planner is.
            process.stdin.write(await self._job + b"\n")
            await process.stdin.drain()
            if await process.stdout.readline():
                self._ready.set_result(None)
            code = await process.wait()
        finally:
            if not self._ready.done():
                self._ready.set_exception(ChannelClosed("the simulated world has ended"))
                self._ready.exception()  # nobody may be waiting for it
            await end_process(process, self._grace_s)
            self.pid = None
        return code

    async def request(
        self, op: str, params: Mapping[str, Any] | None = None, *, timeout_s: float = 5.0
    ) -> Json:
        """Start the world with the job in `params`; return when its robots are announced.

        Raises ChannelClosed, RequestTimeout, ValueError for any other request.
        """
        if op != "start" or params is None:
            raise ValueError("a simulated world is only ever started")
        job = dict(params["job"])
        job["zenoh"] = {"mode": "client", "connect": [params["endpoint"]]}
        self._job.set_result(json.dumps(job).encode())
        try:
            async with asyncio.timeout(timeout_s):
                await asyncio.shield(self._ready)
        except TimeoutError:
            words = f"the simulated world did not start in {timeout_s:g} s"
            raise RequestTimeout(words) from None
        return {}
