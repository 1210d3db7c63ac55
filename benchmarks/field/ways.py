"""What a radio link does to what goes over it: time, loss, silence. Seeded, without I/O."""

import asyncio
import random
from dataclasses import dataclass, field

RETRANSMISSION_S = 0.3
"""How long a stream stands still for a lost packet: what the kernel takes to notice at 100 ms."""


@dataclass
class Weather:
    """How the link is at the moment; both ways look at the same one."""

    delay_s: float = 0.0
    """One way."""

    loss: float = 0.0
    """Share of packets lost."""

    opened: asyncio.Event = field(default_factory=asyncio.Event)
    """Set while the link is not cut."""

    def __post_init__(self) -> None:
        self.opened.set()

    @property
    def is_cut(self) -> bool:
        """Whether nothing gets through."""
        return not self.opened.is_set()


class PacketWay:
    """One way of a link that carries packets: each is late, or lost.

    Args:
        weather: How the link is.
        seed: Of the dice that lose packets.
    """

    def __init__(self, weather: Weather, seed: int) -> None:
        self._weather, self._dice = weather, random.Random(seed)
        self._last_s = 0.0
        self.carried = self.lost = 0

    def due_s(self, now_s: float) -> float | None:
        """Return when a packet arrives that is sent now, None when it is lost. Keeps the order."""
        if self._weather.is_cut or self._dice.random() < self._weather.loss:
            self.lost += 1
            return None
        self.carried += 1
        self._last_s = max(self._last_s, now_s + self._weather.delay_s)
        return self._last_s


class StreamWay:
    """One way of a link that carries a stream: nothing is lost, but all behind a loss waits.

    Args:
        weather: How the link is.
        seed: Of the dice that make it wait.
    """

    def __init__(self, weather: Weather, seed: int) -> None:
        self._weather, self._dice = weather, random.Random(seed)
        self._last_s = 0.0
        self.carried = self.lost = 0

    def due_s(self, now_s: float) -> float:
        """Return when a piece arrives that is sent now."""
        due_s = now_s + self._weather.delay_s
        while self._dice.random() < self._weather.loss:
            self.lost += 1
            due_s += RETRANSMISSION_S
        self.carried += 1
        self._last_s = max(self._last_s, due_s)
        return self._last_s
