"""Lets the wall clock of a Python process jump: it reads its offset from a file at every look.

Loaded by the interpreter itself when this folder is on PYTHONPATH. The monotonic clock stays.
"""

import os
import time
from pathlib import Path

_file = Path(os.environ["WALL_CLOCK_OFFSET_FILE"])
_time, _time_ns = time.time, time.time_ns


def _shifted() -> float:
    return _time() + float(_file.read_text())


def _shifted_ns() -> int:
    return _time_ns() + int(1e9 * float(_file.read_text()))


time.time, time.time_ns = _shifted, _shifted_ns
