"""What the system knows of processes: children, states, and how to be sure that one is still."""

import asyncio
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from time import monotonic

PATIENCE_S = 20.0
PLANNER = "server.live.worker"
"""Stands in the command line of the process that flies the mission."""


def stat(pid: int) -> list[str] | None:
    """Return the fields of a process after its name, the first its state; None when it is gone."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return None
    return text.rpartition(")")[2].split()


def children(pid: int) -> Iterator[int]:
    """Yield the processes that a process has started and that are alive."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            fields = stat(int(entry.name))
            if fields is not None and int(fields[1]) == pid and fields[0] != "Z":
                yield int(entry.name)


def family(pid: int) -> list[int]:
    """Return a process and all that descend from it."""
    found = [pid]
    for one in found:
        found.extend(children(one))
    return found


def command_line(pid: int) -> str:
    """Return a process's command, "" when it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def planner_of(server: int) -> int | None:
    """Return the process that flies a server's mission, None while there is none."""
    return next((pid for pid in children(server) if PLANNER in command_line(pid)), None)


def lives(pid: int) -> bool:
    """Tell whether a process has not ended."""
    fields = stat(pid)
    return fields is not None and fields[0] not in "ZX"


async def stopped(pid: int) -> float:
    """Stop a process; return the moment from which it does nothing."""
    os.kill(pid, signal.SIGSTOP)
    return await _until(pid, "T")


async def killed(pid: int) -> float:
    """Kill a process; return the moment from which it is dead."""
    os.kill(pid, signal.SIGKILL)
    return await _until(pid, "ZX")


async def _until(pid: int, states: str) -> float:
    """Wait for a process's state, or its end."""
    until_s = monotonic() + PATIENCE_S
    while (fields := stat(pid)) is not None and fields[0] not in states:
        if monotonic() > until_s:
            raise AssertionError(f"process {pid} is in state {fields[0]}, not {states}")
        await asyncio.sleep(0.005)
    return monotonic()
