"""The embedded model as a `LanguageModel`: its worker is started on first use."""

import asyncio
import contextlib
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from llm.breaker import Breaker
from llm.chat import ChatReply, ChatRequest, ErrorKind, ModelError
from llm.client import ChatClient, ModelProfile

MODEL = "smollm2-135m-instruct"
WORKER = (sys.executable, "-m", "llm.local.worker")
LONGEST_LINE = 65_536


def _silent(_: str) -> None:
    """Tell nobody."""


@dataclass(eq=False)
class LocalModel:
    """Starts the worker when first asked, again when it has died, and stops it at the end."""

    progress: Callable[[str], None] = _silent
    """Told, in one line, what takes its time."""

    command: tuple[str, ...] = WORKER
    niceness: int = 10
    """How far the worker steps back: live, the planner's ticks go first."""

    start_timeout_s: float = 60.0
    stop_timeout_s: float = 2.0
    """How long a worker may take to end, of its own accord or because it is told to."""

    read_timeout_s: float = 120.0
    """A reply comes in one piece, after all of it has been generated."""

    breaker: Breaker = field(default_factory=lambda: Breaker(threshold=3), repr=False)
    """A worker that cannot be started, or keeps dying, is left alone for a while."""

    _process: asyncio.subprocess.Process | None = field(default=None, init=False, repr=False)
    _client: ChatClient | None = field(default=None, init=False, repr=False)
    _starting: asyncio.Lock = field(default_factory=asyncio.Lock, init=False, repr=False)

    async def __aenter__(self) -> Self:
        """Return the model itself; nothing is started yet."""
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the worker."""
        await self.aclose()

    async def complete(self, request: ChatRequest, timeout_s: float) -> ChatReply:
        """Ask; the time the worker needs to start is not counted.

        Raises:
            ModelError: when there is no reply, or no worker to give one.
        """
        self.breaker.check()
        try:
            client = await self._started()
            reply = await client.complete(request, timeout_s)
        except ModelError as error:
            failure = await self._explained(error)
            if self._client is None or failure is not error:
                self.breaker.failed()
            raise failure from None
        self.breaker.succeeded()
        return reply

    async def _explained(self, error: ModelError) -> ModelError:
        """Say so where the worker's end is behind an error."""
        process = self._process
        if process is None:
            return error
        if error.kind is ErrorKind.CONNECTION:
            # A worker that dies is deaf before its end is known here.
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self.stop_timeout_s):
                    await process.wait()
        if process.returncode is None:
            return error
        words = f"the embedded model's process has ended (code {process.returncode})"
        return ModelError(ErrorKind.CONNECTION, f"{words}; the next call starts it")

    async def aclose(self) -> None:
        """Stop the worker, at the latest `stop_timeout_s` from now."""
        async with self._starting:
            await self._stop()

    async def _started(self) -> ChatClient:
        async with self._starting:
            alive = self._process is not None and self._process.returncode is None
            if self._client is not None and alive:
                return self._client
            await self._stop()
            self.progress(f"starting the embedded language model {MODEL} ...")
            try:
                async with asyncio.timeout(self.start_timeout_s):
                    base_url = await self._start()
            except TimeoutError:
                await self._kill()
                words = f"the embedded model did not start within {self.start_timeout_s:g} s"
                raise ModelError(ErrorKind.TIMEOUT, words) from None
            except ModelError:
                await self._stop()
                raise
            except BaseException:
                # Also when cancelled: a worker busy with loading does not see its input end.
                await self._kill()
                raise
            self.progress(f"the embedded language model {MODEL} is ready")
            profile = ModelProfile(base_url, MODEL, read_timeout_s=self.read_timeout_s)
            self._client = ChatClient(profile)
            return self._client

    async def _start(self) -> str:
        """Start the worker; return its address.

        Raises:
            ModelError: when it cannot be started, says that it cannot be, or ends without a word.
        """
        try:
            self._process = await asyncio.create_subprocess_exec(
                *self.command,
                str(self.niceness),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.DEVNULL,
                limit=LONGEST_LINE,
                # A Ctrl-C is ours to handle: the worker ends when its input does.
                start_new_session=True,
            )
        except OSError as error:
            words = f"the embedded model cannot be started ({type(error).__name__})"
            raise ModelError(ErrorKind.CONNECTION, words) from error
        if self._process.stdout is None:
            raise ModelError(ErrorKind.CONNECTION, "the embedded model cannot be heard")
        while line := await self._process.stdout.readline():
            try:
                message = json.loads(line)
            except ValueError:
                continue
            if isinstance(message, dict) and "base_url" in message:
                return str(message["base_url"])
            if isinstance(message, dict) and "error" in message:
                raise ModelError(ErrorKind.REJECTED, str(message["error"])[:200])
        raise ModelError(ErrorKind.CONNECTION, "the embedded model ended while it was starting")

    async def _kill(self) -> None:
        if self._process is not None and self._process.returncode is None:
            self._process.kill()
        await self._stop()

    async def _stop(self) -> None:
        client, self._client = self._client, None
        process, self._process = self._process, None
        if client is not None:
            await client.aclose()
        if process is None:
            return
        if process.stdin is not None:
            process.stdin.close()
        try:
            async with asyncio.timeout(self.stop_timeout_s):
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()
