"""Warnings that bad messages would cause by the thousand: told a few times, then counted.

A log that is full of one line hides every other, and fills the disk of a small machine.
"""

import logging
from typing import Final

MOST: Final = 5
PERIOD_S: Final = 10.0
"""So many warnings are told in this time, and the others counted."""


class Repetition:
    """One kind of warning. Sans-I/O but for the logger.

    Args:
        logger: That it is told to.
    """

    def __init__(self, logger: logging.Logger) -> None:
        self._logger = logger
        self._since_s = -PERIOD_S
        self._told = 0
        self._untold = 0

    def warn(self, now_s: float, words: str, *values: object) -> None:
        """Tell a warning, or count it where there were too many lately.

        Args:
            now_s: Monotonic clock.
            words: With places for the values, as the logging module fills them.
            values: For those places.
        """
        if now_s - self._since_s >= PERIOD_S:
            if self._untold:
                self._logger.warning("... and %d more of this kind", self._untold)
            self._since_s, self._told, self._untold = now_s, 0, 0
        if self._told >= MOST:
            self._untold += 1
            return
        self._told += 1
        self._logger.warning(words, *values)
