"""Where messages wait between the bus and one reader on the event loop.

Any thread offers, the loop drains. Of a *latest* key only the newest message waits, at the place
in the order where it arrived; events wait in order. Memory is bounded whatever is sent: too many
events or keys are dropped and counted, and the count is an alarm for the reader. However much
arrives, the loop is woken once until it drains. One key cannot crowd the others out: its events are
bounded for themselves, and a reader that must not be kept for long takes some of them at a time.
"""

import asyncio
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from threading import Lock
from typing import Protocol

from vehicles.keys import Delivery
from vehicles.messages import MAX_PAYLOAD


class SampleKind(StrEnum):
    """What happened on a key."""

    PUT = "put"
    """A message, or a liveliness token appeared."""

    DELETE = "delete"
    """A liveliness token disappeared."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One thing that arrived."""

    key: str
    payload: bytes
    kind: SampleKind = SampleKind.PUT


class Receiver(Protocol):
    """Takes samples from any thread; what a bus delivers to."""

    def attach(self) -> None:
        """Tie it to the running event loop. Called by the bus when it subscribes."""
        ...

    def offer(self, sample: Sample) -> None:
        """Take a sample. Safe from any thread; never blocks for long, never raises."""
        ...


class Inbox:
    """A bounded, conflating queue from any thread to one reader on an event loop.

    Args:
        delivery: Says how messages on a key are carried.
        wake: Called on the loop when something waits, once per drain; None when the reader only
            polls.
        max_events: More waiting events than this are dropped, the newest first.
        max_keys: More waiting *latest* keys than this are dropped.
        max_per_key: More waiting events of one key than this are dropped, the newest first.
        per_drain: Events of one key that one drain returns at most, None for all; the others keep
            their place and wait for the next.
    """

    def __init__(
        self,
        delivery: Callable[[str], Delivery],
        wake: Callable[[], None] | None = None,
        max_events: int = 10_000,
        max_keys: int = 20_000,
        max_per_key: int = 2_000,
        per_drain: int | None = None,
    ) -> None:
        self._delivery = delivery
        self._wake = wake
        self._max_events = max_events
        self._max_keys = max_keys
        self._max_per_key = max_per_key
        self._per_drain = per_drain
        self._lock = Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._latest: dict[str, Sample] = {}
        self._events: list[Sample] = []
        self._counts: Counter[str] = Counter()
        self._armed = False
        self._dropped = 0

    @property
    def dropped(self) -> int:
        """How many samples have been dropped since the start, too long ones included."""
        return self._dropped

    def attach(self) -> None:
        """Tie the inbox to the running event loop. Called by the bus when it subscribes.

        Raises:
            RuntimeError: No event loop is running.
        """
        self._loop = asyncio.get_running_loop()

    def offer(self, sample: Sample) -> None:
        """Let a sample wait. Safe from any thread; never blocks for long, never raises."""
        if len(sample.payload) > MAX_PAYLOAD:
            with self._lock:
                self._dropped += 1
            return
        latest = self._delivery(sample.key) is Delivery.LATEST
        with self._lock:
            if latest:
                # Taken out and put in again, so that order is that of the newest arrival.
                self._latest.pop(sample.key, None)
                if len(self._latest) >= self._max_keys:
                    self._dropped += 1
                    return
                self._latest[sample.key] = sample
            elif (
                len(self._events) >= self._max_events
                or self._counts[sample.key] >= self._max_per_key
            ):
                self._dropped += 1
                return
            else:
                self._counts[sample.key] += 1
                self._events.append(sample)
            if self._armed:
                return
            self._armed = True
        self._call()

    def drain(self) -> tuple[Sample, ...]:
        """Return what waits: events in order, then the newest of each *latest* key."""
        with self._lock:
            events, self._events = self._events, []
            self._counts = Counter()
            if self._per_drain is not None:
                events = self._share(events, self._per_drain)
            samples = (*events, *self._latest.values())
            self._latest = {}
            self._armed = bool(self._events)
            again = self._armed
        if again:
            self._call()
        return samples

    def _share(self, events: list[Sample], most: int) -> list[Sample]:
        """Return the first events of each key; the others wait on."""
        taken: Counter[str] = Counter()
        shared = []
        for sample in events:
            if taken[sample.key] < most:
                taken[sample.key] += 1
                shared.append(sample)
            else:
                self._counts[sample.key] += 1
                self._events.append(sample)
        return shared

    def _call(self) -> None:
        loop = self._loop
        if self._wake is None or loop is None or loop.is_closed():
            return
        try:
            loop.call_soon_threadsafe(self._wake)
        except RuntimeError:
            # The loop was closed between the check and the call: nobody is left to be woken.
            with self._lock:
                self._armed = False
