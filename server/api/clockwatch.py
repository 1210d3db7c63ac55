"""A wall clock that jumps: nothing flies by it, but the journal's times are told by it."""

import asyncio
import time
from collections.abc import Callable

LOOK_S = 1.0
JUMP_S = 2.0
"""A correction of less is how clocks are kept right."""

Clock = Callable[[], float]


class ClockWatch:
    """Compares the wall clock with the monotonic one, look by look.

    Args:
        tell: Called with a sentence for people at every jump.
        wall: The wall clock, seconds.
        monotonic: One that never jumps, seconds.
    """

    def __init__(
        self,
        tell: Callable[[str], None],
        wall: Clock = time.time,
        monotonic: Clock = time.monotonic,
    ) -> None:
        self._tell, self._wall, self._monotonic = tell, wall, monotonic
        self._apart_s: float | None = None

    def look(self) -> None:
        """Compare the two clocks now."""
        apart_s = self._wall() - self._monotonic()
        jump_s = 0.0 if self._apart_s is None else apart_s - self._apart_s
        self._apart_s = apart_s
        if abs(jump_s) > JUMP_S:
            way = "forward" if jump_s > 0.0 else "back"
            self._tell(
                f"This machine's clock was set {way} by {abs(jump_s):.0f} s."
                " Times in the journal before and after do not compare; nothing flies by them."
            )

    async def run(self) -> None:
        """Look for ever."""
        while True:
            self.look()
            await asyncio.sleep(LOOK_S)
