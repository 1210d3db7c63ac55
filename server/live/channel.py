"""JSON lines between two of our own processes.

One line is one object of at most `MAX_LINE_BYTES`. The parent asks `{"id", "op", "params"}`, the
child answers `{"id", "ok"}` or `{"id", "error": {"code", "message", "details"}}`; the child also
pushes `{"push": message}` whenever it likes. End of file is the end of the other side.
"""

import asyncio
import contextlib
import itertools
import json
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

import structlog

from server.live.outbox import Frame, Outbox, OutboxClosed

log = structlog.get_logger(__name__)

MAX_LINE_BYTES = 8 * 1024 * 1024
"""A snapshot of a thousand robots and two thousand targets takes about one MiB."""

MAX_PENDING = 256
"""Requests under way at once on one channel; more are refused."""

URGENT = frozenset({"hold", "stop"})
"""Requests for which there is always room."""

_PUSH_PREFIX = '{"push":'

Json = dict[str, Any]
Handler = Callable[[str, Json], Awaitable[Json]]


class ChannelError(Exception):
    """Base of what can go wrong with a request."""


class ChannelClosed(ChannelError):
    """Raised when the other process has gone."""


class RequestTimeout(ChannelError):
    """Raised when the other process did not answer in time."""


class RequestRefused(ChannelError):
    """Raised when the other side answers with an error; a handler raises it to do so."""

    def __init__(self, code: str, message: str, details: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.details = dict(details or {})


class ProtocolError(ChannelError):
    """Raised when a line is too long or is not what the protocol says."""


def encode(message: Mapping[str, Any]) -> str:
    """Return compact JSON on one line. Raises ValueError for NaN and infinity."""
    return json.dumps(message, separators=(",", ":"), allow_nan=False)


def frame(message: Json) -> Frame:
    """Return a message with its text."""
    return Frame(message, encode(message))


class Caller:
    """The asking side of a channel."""

    def __init__(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        receive: Callable[[Frame], None],
    ) -> None:
        self._reader = reader
        self._writer = writer
        self._receive = receive
        self._ids = itertools.count(1)
        self._pending: dict[int, asyncio.Future[Json]] = {}
        self._closed = False

    async def run(self) -> None:
        """Deliver pushes and answers until end of file. Raises ProtocolError."""
        try:
            while line := await _read_line(self._reader):
                self._take(line)
        finally:
            self._closed = True
            for future in self._pending.values():
                if not future.done():
                    future.set_exception(ChannelClosed("the mission process has ended"))
            self._pending.clear()

    async def request(
        self, op: str, params: Mapping[str, Any] | None = None, *, timeout_s: float = 5.0
    ) -> Json:
        """Ask and wait for the answer.

        Raises ChannelClosed, RequestTimeout, RequestRefused.
        """
        if self._closed:
            raise ChannelClosed("the mission process has ended")
        if len(self._pending) >= MAX_PENDING and op not in URGENT:
            raise RequestRefused("busy", "too many requests are waiting for the mission")
        request_id = next(self._ids)
        future: asyncio.Future[Json] = asyncio.get_running_loop().create_future()
        self._pending[request_id] = future
        line = encode({"id": request_id, "op": op, "params": dict(params or {})})
        try:
            async with asyncio.timeout(timeout_s):
                self._writer.write(line.encode() + b"\n")
                await self._writer.drain()
                return await future
        except TimeoutError:
            raise RequestTimeout(f"no answer to {op} within {timeout_s:g} s") from None
        except (ConnectionError, RuntimeError) as error:
            raise ChannelClosed("the mission process has ended") from error
        finally:
            self._pending.pop(request_id, None)
            if future.done() and not future.cancelled():
                future.exception()  # looked at, so that asyncio does not warn of it

    def _take(self, line: str) -> None:
        message = _object(line)
        if "push" in message:
            pushed = message["push"]
            if not isinstance(pushed, dict):
                raise ProtocolError("a pushed message must be an object")
            self._receive(Frame(pushed, _pushed_text(line, pushed)))
            return
        future = self._pending.get(message.get("id", 0))
        if future is None or future.done():
            return  # its asker has given up
        if "error" in message:
            error = message["error"]
            refusal = RequestRefused(error["code"], error["message"], error.get("details"))
            future.set_exception(refusal)
        else:
            future.set_result(message["ok"])


class Responder:
    """The answering side of a channel. Each request runs in its own task, bounded.

    A fault of the handler, or an answer that cannot be told, is its asker's trouble alone: it is
    logged and answered with `internal_error`, and never ends the flight.
    """

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, handler: Handler
    ) -> None:
        self._reader = reader
        self._writer = writer
        self._handler = handler
        self._outbox = Outbox()
        self._answers = Outbox(max_events=2 * MAX_PENDING)
        self._active = 0
        self.lost_events = 0
        """Events for which there was no room because nobody reads."""

    def push(self, message: Json) -> None:
        """Send a message when the reader has time; a newer snapshot replaces an older one."""
        if not self._outbox.put(Frame(message, _PUSH_PREFIX + encode(message) + "}")):
            self.lost_events += 1

    async def run(self) -> None:
        """Serve until the asking side closes its end. Raises ProtocolError."""
        async with asyncio.TaskGroup() as tasks:
            senders = [
                tasks.create_task(self._send(self._answers)),
                tasks.create_task(self._send(self._outbox)),
            ]
            handlers: set[asyncio.Task[None]] = set()
            try:
                while line := await _read_line(self._reader):
                    task = tasks.create_task(self._answer(_object(line)))
                    handlers.add(task)
                    task.add_done_callback(handlers.discard)
            finally:
                for task in (*senders, *handlers):
                    task.cancel()

    async def _answer(self, request: Json) -> None:
        request_id = request.get("id", 0)
        if self._active >= MAX_PENDING and request.get("op") not in URGENT:
            answer = _refused(request_id, RequestRefused("busy", "too many requests at once"))
        else:
            self._active += 1
            try:
                told = await self._handler(request["op"], request.get("params", {}))
                answer = frame({"id": request_id, "ok": told})
            except RequestRefused as refused:
                answer = _refused(request_id, refused)
            except Exception:  # a fault in one request must not end the flight
                log.exception("a request failed", op=request.get("op"))
                words = "the mission failed on this request"
                answer = _refused(request_id, RequestRefused("internal_error", words))
            finally:
                self._active -= 1
        self._answers.put(answer)

    async def _send(self, outbox: Outbox) -> None:
        with contextlib.suppress(OutboxClosed, ConnectionError):
            while True:
                sent = await outbox.get()
                self._writer.write(sent.text.encode() + b"\n")
                await self._writer.drain()


def _refused(request_id: int, refused: RequestRefused) -> Frame:
    error = {"code": refused.code, "message": refused.message, "details": refused.details}
    return frame({"id": request_id, "error": error})


async def _read_line(reader: asyncio.StreamReader) -> str:
    """Return the next line, "" at the end of file (a line cut off there is dropped)."""
    try:
        line = await reader.readline()
    except ValueError as error:
        raise ProtocolError(f"a line is longer than {MAX_LINE_BYTES} bytes") from error
    except ConnectionError:
        return ""
    return line.decode("utf-8", "replace") if line.endswith(b"\n") else ""


def _object(line: str) -> Json:
    try:
        message = json.loads(line)
    except ValueError as error:
        raise ProtocolError("a line is not JSON") from error
    if not isinstance(message, dict):
        raise ProtocolError("a line is not an object")
    return message


def _pushed_text(line: str, pushed: Json) -> str:
    """Return the text of a pushed message, cut out of its line where that is possible."""
    line = line.rstrip("\n")
    if line.startswith(_PUSH_PREFIX) and len(line) > len(_PUSH_PREFIX):
        return line[len(_PUSH_PREFIX) : -1]
    return encode(pushed)
