"""What runs beside a live mission gives way to it."""

import contextlib
import os
from typing import Final

NICENESS: Final = 10
"""Of experiments and forks."""


def give_way(pid: int) -> None:
    """Let a process run after the mission's. One that has ended, or gives way already, stays."""
    with contextlib.suppress(ProcessLookupError):
        # Only root may take a higher priority than it was given.
        if os.getpriority(os.PRIO_PROCESS, pid) < NICENESS:
            os.setpriority(os.PRIO_PROCESS, pid, NICENESS)
