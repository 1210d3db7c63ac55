"""How a child process makes sure that it ends when it should."""

import os
import threading

LAST_WORD_S = 3.0
"""From the wish to end to the end, whatever a thread is doing."""

OVERRUN = 70
"""Exit code of a process that had to be ended this way."""


def end_within(seconds: float = LAST_WORD_S) -> None:
    """End this process after so long, unless it has ended by itself until then.

    An event loop waits for its worker threads before it closes, and a thread that is
    compiling kernels cannot be cancelled: without this a process could outlive its parent.
    """
    timer = threading.Timer(seconds, os._exit, (OVERRUN,))
    timer.daemon = True
    timer.start()
