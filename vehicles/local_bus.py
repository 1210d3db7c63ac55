"""A bus inside one process and one event loop: for tests and for everything in one process."""

from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Self

from vehicles.bus import BusError
from vehicles.inbox import Receiver, Sample, SampleKind


def matches(key_expr: str, key: str) -> bool:
    """Return whether a key is one that an expression means; `*` stands for one part."""
    wanted, given = key_expr.split("/"), key.split("/")
    return len(wanted) == len(given) and all(
        part in ("*", found) for part, found in zip(wanted, given, strict=True)
    )


class LocalHub:
    """What the local buses of one process share: who listens, who is alive."""

    def __init__(self) -> None:
        self._listeners: dict[int, tuple[str, Receiver]] = {}
        self._watchers: dict[int, tuple[str, Receiver]] = {}
        self._tokens: dict[int, str] = {}
        self._next = 0

    def publish(self, key: str, payload: bytes) -> None:
        """Offer a payload to every inbox that listens to its key."""
        for key_expr, inbox in tuple(self._listeners.values()):
            if matches(key_expr, key):
                inbox.offer(Sample(key, payload))

    def listen(self, key_expr: str, inbox: Receiver) -> int:
        """Add a listener; return its number."""
        number = self._number()
        self._listeners[number] = (key_expr, inbox)
        return number

    def watch(self, key_expr: str, inbox: Receiver) -> int:
        """Add a watcher of tokens and tell it of those there are; return its number."""
        number = self._number()
        self._watchers[number] = (key_expr, inbox)
        for key in self.tokens(key_expr):
            inbox.offer(Sample(key, b""))
        return number

    def announce(self, key: str) -> int:
        """Add a token; return its number. Watchers hear of the first on a key only."""
        known = key in self._tokens.values()
        number = self._number()
        self._tokens[number] = key
        if not known:
            self._tell(key, SampleKind.PUT)
        return number

    def tokens(self, key_expr: str) -> tuple[str, ...]:
        """Return the keys of the tokens that match, each once."""
        held = dict.fromkeys(key for key in self._tokens.values() if matches(key_expr, key))
        return tuple(held)

    def remove(self, numbers: Iterable[int]) -> None:
        """Remove listeners, watchers and tokens; unknown numbers change nothing."""
        for number in numbers:
            self._listeners.pop(number, None)
            self._watchers.pop(number, None)
            key = self._tokens.pop(number, None)
            if key is not None and key not in self._tokens.values():
                self._tell(key, SampleKind.DELETE)

    def _tell(self, key: str, kind: SampleKind) -> None:
        for key_expr, inbox in tuple(self._watchers.values()):
            if matches(key_expr, key):
                inbox.offer(Sample(key, b"", kind))

    def _number(self) -> int:
        self._next += 1
        return self._next


class LocalSubscription:
    """One thing declared on a local bus."""

    def __init__(self, end: Callable[[], None]) -> None:
        self._end = end

    async def close(self) -> None:
        """End it. Harmless when it has ended already."""
        self._end()


class LocalBus:
    """One party's access to a hub, with the life of a session: `async with`.

    Args:
        hub: Shared by all parties of the process.
    """

    def __init__(self, hub: LocalHub) -> None:
        self._hub = hub
        self._declared: set[int] | None = None

    async def __aenter__(self) -> Self:
        self._declared = set()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        declared, self._declared = self._declared, None
        self._hub.remove(sorted(declared or ()))

    def publish(self, key: str, payload: bytes) -> None:
        """Offer a payload to whoever listens, this party included."""
        self._open()
        self._hub.publish(key, payload)

    async def subscribe(self, key_expr: str, inbox: Receiver) -> LocalSubscription:
        """Let whatever is published under matching keys wait in an inbox."""
        declared = self._open()
        inbox.attach()
        return self._hold(declared, self._hub.listen(key_expr, inbox))

    async def announce(self, key: str) -> LocalSubscription:
        """Hold a token until it is closed or this bus is."""
        declared = self._open()
        return self._hold(declared, self._hub.announce(key))

    async def watch(self, key_expr: str, inbox: Receiver) -> LocalSubscription:
        """Let tokens wait in an inbox as they appear and disappear."""
        declared = self._open()
        inbox.attach()
        return self._hold(declared, self._hub.watch(key_expr, inbox))

    async def present(self, key_expr: str) -> tuple[str, ...]:
        """Return the keys of the tokens that are held now."""
        self._open()
        return self._hub.tokens(key_expr)

    def _hold(self, declared: set[int], number: int) -> LocalSubscription:
        declared.add(number)

        def end() -> None:
            declared.discard(number)
            self._hub.remove((number,))

        return LocalSubscription(end)

    def _open(self) -> set[int]:
        if self._declared is None:
            raise BusError("the local bus is not open: use it inside `async with`")
        return self._declared
