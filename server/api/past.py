"""The last pictures of a mission, in bounded memory, to be looked at again while it flies on."""

import json
import zlib
from bisect import bisect_right
from collections import deque
from typing import Any, Final

from server.live.outbox import Frame

STEP_S: Final = 1.0
"""Mission time between two pictures."""

MAX_PICTURES: Final = 1800
MAX_BYTES: Final = 24 * 2**20
"""Half an hour of a small team; a team of a hundred robots reaches back for a few minutes."""

PACK_BYTES: Final = 128 * 1024
"""Longer texts are kept as they are: packing them would cost the event loop too long."""


class Past:
    """Pictures a second apart, the oldest forgotten first."""

    def __init__(self, max_bytes: int = MAX_BYTES, max_pictures: int = MAX_PICTURES) -> None:
        self._max_bytes = max_bytes
        self._max_pictures = max_pictures
        self._times: deque[float] = deque()
        self._texts: deque[tuple[bytes, bool]] = deque()
        """Texts, and whether each is packed."""

        self._bytes = 0

    @property
    def from_s(self) -> float | None:
        """Mission time of the oldest picture, None where there is none."""
        return self._times[0] if self._times else None

    @property
    def size_bytes(self) -> int:
        """What the pictures take."""
        return self._bytes

    def take(self, said: Frame) -> None:
        """Keep a snapshot if the last one is old enough. Mission time that went back clears."""
        time_s = said.data["time_s"]
        if time_s is None:
            return
        if self._times and time_s < self._times[-1]:
            self.clear()
        if self._times and time_s < self._times[-1] + STEP_S - 1e-6:
            return
        text = said.text.encode()
        packed = len(text) <= PACK_BYTES
        kept = zlib.compress(text, 1) if packed else text
        self._times.append(time_s)
        self._texts.append((kept, packed))
        self._bytes += len(kept)
        while self._bytes > self._max_bytes or len(self._times) > self._max_pictures:
            self._times.popleft()
            self._bytes -= len(self._texts.popleft()[0])

    def at(self, time_s: float) -> dict[str, Any] | None:
        """Return the newest picture at or before a mission time, None where it is not kept."""
        index = bisect_right(self._times, time_s + 1e-6) - 1
        if index < 0:
            return None
        text, packed = self._texts[index]
        found: dict[str, Any] = json.loads(zlib.decompress(text) if packed else text)
        return found

    def clear(self) -> None:
        """Forget everything."""
        self._times.clear()
        self._texts.clear()
        self._bytes = 0
