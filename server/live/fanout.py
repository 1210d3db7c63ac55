"""From one mission to many readers, none of whom is ever waited for."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Self

from server.live.outbox import Frame, Outbox, OutboxClosed

MAX_EVENTS_BEHIND = 256
"""A reader further behind than this is dropped: it could not be told the truth any more."""

TOO_SLOW = "too slow: events would have been lost"
MISSION_OVER = "the mission was removed"


class Fanout:
    """Hands every frame to every subscription. Late-comers get the last snapshot at once."""

    def __init__(self, max_events: int = MAX_EVENTS_BEHIND) -> None:
        self._max_events = max_events
        self._outboxes: set[Outbox] = set()
        self._last: Frame | None = None
        self.dropped = 0
        """Subscriptions closed because they were too slow."""

    @property
    def last(self) -> Frame | None:
        """The newest snapshot."""
        return self._last

    @property
    def readers(self) -> int:
        """How many subscriptions are open."""
        return len(self._outboxes)

    def publish(self, frame: Frame) -> None:
        """Queue a frame for every reader; drop those who have no room for it."""
        if frame.is_snapshot:
            self._last = frame
        for outbox in tuple(self._outboxes):
            if not outbox.put(frame):
                self._outboxes.discard(outbox)
                self.dropped += 1
                outbox.close(TOO_SLOW)

    def close(self, reason: str = MISSION_OVER) -> None:
        """End every subscription."""
        for outbox in self._outboxes:
            outbox.close(reason)
        self._outboxes.clear()

    @contextmanager
    def subscribe(self) -> Iterator[Outbox]:
        """Open a subscription for the time of the context."""
        outbox = Outbox(self._max_events)
        if self._last is not None:
            outbox.put(self._last)
        self._outboxes.add(outbox)
        try:
            yield outbox
        finally:
            self._outboxes.discard(outbox)


class Messages:
    """The messages of a subscription until it is closed. A cancelled read loses nothing."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> dict[str, Any]:
        try:
            return (await self._outbox.get()).data
        except OutboxClosed:
            raise StopAsyncIteration from None
