"""The bus over Eclipse Zenoh.

Zenoh calls back on threads of its own and its calls may block, so: callbacks only put into an
inbox; opening, closing and declaring happen in worker threads; *latest* messages are put from
the event loop with the congestion control that drops, which never blocks (a few microseconds);
events, which must not be dropped, are put by one writer thread that may wait. So are *latest*
messages of more than one network batch: Zenoh waits between their fragments. Of those too only
the newest per key waits.
"""

import asyncio
import contextlib
import json
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from time import monotonic
from types import TracebackType
from typing import Any, Protocol, Self, TypeVar

import zenoh

from vehicles.bus import BusError
from vehicles.inbox import Receiver, Sample, SampleKind
from vehicles.keys import Delivery
from vehicles.repetition import Repetition
from vehicles.zenoh_refusal import refusal
from vehicles.zenoh_settings import ZenohSettings, configuration

logger = logging.getLogger(__name__)

ATTEMPT_MS = 1000
"""One attempt to connect; the whole may take `open_timeout_s`."""

MAX_WAITING = 10_000
"""Events that wait for the writer thread; more are dropped and counted."""

WHOLE_BYTES = 48 << 10
"""A message up to so long goes in one batch (64 KiB with what Zenoh adds)."""

TELL_AFTER_S, TELL_EVERY_S = 5.0, 60.0
"""When a session that waits for its first connection says so in the log."""

ASKED_AGAIN_AFTER_S = (0.05, 0.2)
"""Nobody holds a token when three answers are empty: on a starved machine Zenoh now and then ends
one that has not begun."""

ResultT = TypeVar("ResultT")


class Declared(Protocol):
    """What Zenoh hands out for a declaration; it ends when nobody holds it any more."""

    def undeclare(self) -> object:
        """End it."""
        ...


class ZenohSubscription:
    """Something declared on a Zenoh session."""

    def __init__(self, declared: Declared, held: set[Declared]) -> None:
        self._declared: Declared | None = declared
        self._held = held
        held.add(declared)

    async def close(self) -> None:
        """End it. Harmless when it, or its session, has ended already."""
        declared, self._declared = self._declared, None
        if declared is not None and declared in self._held:
            self._held.discard(declared)
            with contextlib.suppress(zenoh.ZError):
                await asyncio.to_thread(declared.undeclare)


class ZenohBus:
    """One Zenoh session as a bus: `async with`, which closes it whatever happens.

    Args:
        settings: Where and how to connect.
        delivery: Says how messages on a key are carried.
    """

    def __init__(self, settings: ZenohSettings, delivery: Callable[[str], Delivery]) -> None:
        self.settings = settings
        self._delivery = delivery
        self._session: zenoh.Session | None = None
        self._writer: ThreadPoolExecutor | None = None
        self._lock = Lock()
        self._waiting = 0
        self._long: dict[str, bytes] = {}
        self._dropped = 0
        self._drops = Repetition(logger)
        self._endpoints: tuple[str, ...] = ()
        self._held: set[Declared] = set()

    @property
    def endpoints(self) -> tuple[str, ...]:
        """Where this session listens, the system's choice of port filled in."""
        return self._endpoints

    @property
    def dropped(self) -> int:
        """Events that were dropped since the start because the writer was too far behind."""
        return self._dropped

    async def __aenter__(self) -> Self:
        """Open the session.

        Raises:
            BusError: Nothing could be reached, or listened on, in time.
        """
        if self.settings.is_exposed:
            where = ", ".join(self.settings.listen)
            logger.warning("whoever reaches %s may fly this team: set users or mutual TLS", where)
        self._session = await self._opened()
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="zenoh-writer")
        try:
            self._endpoints = await asyncio.to_thread(_listening, self._session, self.settings)
        except BaseException:
            await self._close()
            raise
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self._close()

    def publish(self, key: str, payload: bytes) -> None:
        """Send a payload; the key says how."""
        session, writer = self._session, self._writer
        if session is None or writer is None:
            raise BusError("the Zenoh session is not open: use it inside `async with`")
        latest = self._delivery(key) is Delivery.LATEST
        if latest and len(payload) <= WHOLE_BYTES:
            session.put(key, payload, congestion_control=zenoh.CongestionControl.DROP)
            return
        if latest:
            with self._lock:
                waits = key in self._long
                self._long[key] = payload
            if not waits:
                writer.submit(self._write_long, session, key)
            return
        with self._lock:
            room = self._waiting < MAX_WAITING
            self._waiting += room
            self._dropped += not room
        if room:
            writer.submit(self._write, session, key, payload)
        else:
            self._drops.warn(monotonic(), "an event on %s is dropped: too many wait", key)

    async def subscribe(self, key_expr: str, inbox: Receiver) -> ZenohSubscription:
        """Let whatever is published under matching keys wait in an inbox."""
        session = self._opened_session()
        inbox.attach()
        subscriber = await asyncio.to_thread(session.declare_subscriber, key_expr, _receiver(inbox))
        return ZenohSubscription(subscriber, self._held)

    async def announce(self, key: str) -> ZenohSubscription:
        """Hold a liveliness token."""
        session = self._opened_session()
        token = await asyncio.to_thread(session.liveliness().declare_token, key)
        return ZenohSubscription(token, self._held)

    async def watch(self, key_expr: str, inbox: Receiver) -> ZenohSubscription:
        """Let tokens wait in an inbox as they appear and disappear."""
        session = self._opened_session()
        inbox.attach()
        receive = _receiver(inbox)

        def declare() -> Any:
            return session.liveliness().declare_subscriber(key_expr, receive, history=True)

        subscriber = await asyncio.to_thread(declare)
        return ZenohSubscription(subscriber, self._held)

    async def present(self, key_expr: str) -> tuple[str, ...]:
        """Return the keys of the tokens that are held now."""
        session = self._opened_session()

        def ask() -> tuple[str, ...]:
            replies = session.liveliness().get(key_expr, timeout=2.0)
            return tuple(
                dict.fromkeys(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)
            )

        for pause_s in ASKED_AGAIN_AFTER_S:
            found = await asyncio.to_thread(ask)
            if found:
                return found
            await asyncio.sleep(pause_s)
        return await asyncio.to_thread(ask)

    # ------------------------------------------------------------------ inside

    def _opened_session(self) -> zenoh.Session:
        if self._session is None:
            raise BusError("the Zenoh session is not open: use it inside `async with`")
        return self._session

    def _write(self, session: zenoh.Session, key: str, payload: bytes) -> None:
        try:
            _put(session, key, payload, zenoh.CongestionControl.BLOCK, zenoh.Priority.DATA_HIGH)
        finally:
            with self._lock:
                self._waiting -= 1

    def _write_long(self, session: zenoh.Session, key: str) -> None:
        with self._lock:
            payload = self._long.pop(key)
        _put(session, key, payload, zenoh.CongestionControl.DROP, zenoh.Priority.DATA_LOW)

    async def _opened(self) -> zenoh.Session:
        """Try to open the session until it works or the time is over."""
        limit_s = self.settings.open_timeout_s
        began_s = monotonic()
        tell_s = began_s + TELL_AFTER_S
        while True:
            try:
                return await _uninterrupted(self._open_once, _end)
            except zenoh.ZError as error:
                now_s = monotonic()
                over = limit_s is not None and now_s - began_s >= limit_s
                if not self.settings.connect or over:
                    raise BusError(await refusal(self.settings, error)) from error
                if now_s >= tell_s:
                    tell_s = now_s + TELL_EVERY_S
                    logger.warning("still waiting: %s", await refusal(self.settings, error))
            await asyncio.sleep(0.2)

    def _open_once(self) -> zenoh.Session:
        return zenoh.open(configuration(self.settings, ATTEMPT_MS))

    async def _close(self) -> None:
        session, self._session = self._session, None
        writer, self._writer = self._writer, None
        self._held.clear()

        def close() -> None:
            if writer is not None:
                writer.shutdown(wait=True)
            if session is not None:
                _end(session)

        # An unclosed session lets the process hang at its end: close even when cancelled.
        await _uninterrupted(close, lambda _: None)


async def _uninterrupted(
    work: Callable[[], ResultT], discard: Callable[[ResultT], object]
) -> ResultT:
    """Return what a blocking call returns; when cancelled, let it end and discard its result.

    It is waited for however often this is cancelled.
    """
    task = asyncio.ensure_future(asyncio.to_thread(work))
    cancelled = False
    while not task.done():
        try:
            await asyncio.wait({task})
        except asyncio.CancelledError:
            cancelled = True
    if not cancelled:
        return task.result()
    with contextlib.suppress(zenoh.ZError):
        await asyncio.to_thread(discard, task.result())
    raise asyncio.CancelledError


def _put(
    session: zenoh.Session,
    key: str,
    payload: bytes,
    congestion: zenoh.CongestionControl,
    priority: zenoh.Priority,
) -> None:
    """Put from the writer's thread; what cannot be sent is told."""
    try:
        session.put(key, payload, congestion_control=congestion, priority=priority)
    except zenoh.ZError as error:
        logger.warning("a message on %s was not sent: %s", key, error)


def _end(session: zenoh.Session) -> None:
    close: Callable[[], object] = session.close
    close()


def _receiver(inbox: Receiver) -> Callable[[zenoh.Sample], None]:
    """Return the callback that only puts a sample into an inbox."""

    def receive(sample: zenoh.Sample) -> None:
        gone = sample.kind == zenoh.SampleKind.DELETE
        inbox.offer(
            Sample(
                key=str(sample.key_expr),
                payload=sample.payload.to_bytes(),
                kind=SampleKind.DELETE if gone else SampleKind.PUT,
            )
        )

    return receive


def _listening(session: zenoh.Session, settings: ZenohSettings) -> tuple[str, ...]:
    """Return where a session listens."""
    if not settings.has_free_port:
        return settings.listen
    for reply in session.get(f"@/{session.zid()}/{settings.mode.value}"):
        if reply.ok is not None:
            return tuple(json.loads(reply.ok.payload.to_string())["locators"])
    raise BusError("Zenoh does not say which port it listens on")
