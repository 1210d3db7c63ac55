"""How a mission's process does: memory, tasks, the models' accounts, the bus. For metrics."""

import asyncio
import os
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from server.live.outbox import VITALS
from server.result import LoopTally

PERIOD_S: Final = 1.0

_PAGE_BYTES: Final = os.sysconf("SC_PAGE_SIZE")


def process_vitals() -> dict[str, int]:
    """Return this process's resident bytes, asyncio tasks and threads."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    return {
        "resident_bytes": pages * _PAGE_BYTES,
        "tasks": len(asyncio.all_tasks()),
        "threads": threading.active_count(),
    }


def account(tally: LoopTally) -> dict[str, float]:
    """Return one loop's account of its model, as sums since the start."""
    return {
        "calls": tally.calls,
        "tries": tally.tries,
        "valid": tally.valid,
        "adopted": tally.adopted,
        "tokens_in": tally.tokens_in.total,
        "tokens_out": tally.tokens_out.total,
        "seconds": tally.latency_s.total,
    }


async def report_vitals(
    tell: Callable[[dict[str, Any]], None],
    tallies: Callable[[], Mapping[str, LoopTally]],
    counters: Callable[[], Mapping[str, int]],
) -> None:
    """Tell them once a second until cancelled."""
    while True:
        tell(
            {
                "type": VITALS,
                "process": process_vitals(),
                "llm": {name: account(tally) for name, tally in tallies().items()},
                "counters": dict(counters()),
            }
        )
        await asyncio.sleep(PERIOD_S)
