"""What waits to be sent to one reader: bounded, and the newest snapshot wins.

A snapshot is a state, and so is a checkpoint: whoever is late needs only the last. An event
is a fact: it is kept in order, up to a bound. The same rule serves the mission process's pipe and
every client of the stream, so that a slow reader costs memory for a moment and time never.
"""

import asyncio
from collections import deque
from dataclasses import dataclass, field
from typing import Any

SNAPSHOT = "snapshot"
CHECKPOINT = "checkpoint"

VITALS = "vitals"

_STATES = frozenset({SNAPSHOT, CHECKPOINT, VITALS})


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One message with its JSON text, encoded once however many read it."""

    data: dict[str, Any]
    text: str

    @property
    def kind(self) -> str:
        """The message's type."""
        return str(self.data.get("type", ""))

    @property
    def is_snapshot(self) -> bool:
        """Whether it is a snapshot."""
        return self.kind == SNAPSHOT

    @property
    def is_state(self) -> bool:
        """Whether a newer frame of this kind makes it worthless."""
        return self.kind in _STATES


class OutboxClosed(Exception):
    """Raised when nothing more comes out of an outbox; says why."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


@dataclass(slots=True, eq=False)
class Outbox:
    """One reader's queue. Single reader, any number of writers on the same event loop."""

    max_events: int = 1024
    _events: deque[Frame] = field(default_factory=deque)
    _states: dict[str, Frame] = field(default_factory=dict)
    _closed: str | None = None
    _wake: asyncio.Event = field(default_factory=asyncio.Event)
    replaced: int = 0
    """States that a newer one replaced before they were read."""

    def put(self, frame: Frame) -> bool:
        """Queue a frame; return False when it found no room (an event beyond the bound)."""
        if self._closed is not None:
            return False
        if frame.is_state:
            self.replaced += self._states.pop(frame.kind, None) is not None
            # Behind what was told before it: a checkpoint is kept before what it holds is shown.
            self._states[frame.kind] = frame
        elif len(self._events) >= self.max_events:
            return False
        else:
            self._events.append(frame)
        self._wake.set()
        return True

    def close(self, reason: str) -> None:
        """Let the reader have what is queued, then end with `OutboxClosed`."""
        if self._closed is None:
            self._closed = reason
        self._wake.set()

    async def get(self) -> Frame:
        """Return the next frame: events first, in order, then the newest states.

        Raises OutboxClosed when it is closed and empty.
        """
        while True:
            if self._events:
                return self._events.popleft()
            if self._states:
                return self._states.pop(next(iter(self._states)))
            if self._closed is not None:
                raise OutboxClosed(self._closed)
            self._wake.clear()
            await self._wake.wait()
