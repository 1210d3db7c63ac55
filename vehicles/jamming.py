"""Simulated jamming, at the point where an agent meets the bus.

A jammed robot's messages are dropped both ways; its liveliness token stays, so that the planner
sees a silent robot that is alive.
"""

from vehicles.bus import Bus, Subscription
from vehicles.inbox import Receiver, Sample


class JammableBus:
    """A bus that can be jammed. Jamming takes effect at once in both directions."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self.jammed = False

    def publish(self, key: str, payload: bytes) -> None:
        """Send a payload, unless jammed."""
        if not self.jammed:
            self._bus.publish(key, payload)

    async def subscribe(self, key_expr: str, inbox: Receiver) -> Subscription:
        """Let what is published wait in an inbox, except while jammed."""
        return await self._bus.subscribe(key_expr, _Gate(inbox, self))

    async def announce(self, key: str) -> Subscription:
        """Hold a token; jamming leaves it."""
        return await self._bus.announce(key)

    async def watch(self, key_expr: str, inbox: Receiver) -> Subscription:
        """Let tokens wait in an inbox, except while jammed."""
        return await self._bus.watch(key_expr, _Gate(inbox, self))

    async def present(self, key_expr: str) -> tuple[str, ...]:
        """Return the keys of the tokens that are held now."""
        return await self._bus.present(key_expr)


class _Gate:
    """Passes samples on to an inbox while the bus is not jammed."""

    def __init__(self, inbox: Receiver, bus: JammableBus) -> None:
        self._inbox = inbox
        self._bus = bus

    def attach(self) -> None:
        self._inbox.attach()

    def offer(self, sample: Sample) -> None:
        if not self._bus.jammed:
            self._inbox.offer(sample)
