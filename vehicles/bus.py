"""The seam between the vehicles and whatever carries their messages."""

from typing import Protocol

from vehicles.inbox import Receiver


class BusError(Exception):
    """Raised when a bus cannot be opened or is used while it is not open; says the cure."""


class Subscription(Protocol):
    """Something declared on a bus that lasts until it is closed."""

    async def close(self) -> None:
        """End it. Harmless when it has ended already."""
        ...


class Bus(Protocol):
    """Carries bytes under keys. `*` in a key expression stands for one part of a key.

    Opened and closed by its owner (`async with`); everything is called on one event loop.
    """

    def publish(self, key: str, payload: bytes) -> None:
        """Send a payload without blocking; the key says how it is carried (`Delivery`).

        Raises:
            BusError: The bus is not open.
        """
        ...

    async def subscribe(self, key_expr: str, inbox: Receiver) -> Subscription:
        """Let whatever is published under matching keys wait in an inbox.

        Raises:
            BusError: The bus is not open.
        """
        ...

    async def announce(self, key: str) -> Subscription:
        """Hold a liveliness token: it disappears when this process or its link does.

        Raises:
            BusError: The bus is not open.
        """
        ...

    async def watch(self, key_expr: str, inbox: Receiver) -> Subscription:
        """Let tokens wait in an inbox as they appear (put) and disappear (delete).

        Those that are there already appear at once.

        Raises:
            BusError: The bus is not open.
        """
        ...

    async def present(self, key_expr: str) -> tuple[str, ...]:
        """Return the keys of the tokens that are held now by anybody.

        Raises:
            BusError: The bus is not open.
        """
        ...
