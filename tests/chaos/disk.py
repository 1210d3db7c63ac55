"""A small disk for the journal, which can be filled until nothing more can be written.

It is a tmpfs of its own mount namespace: what fails on it fails with the system's own "no space
left on device". Where the system allows no such namespace, files of the processes that write there
may no longer grow instead.
"""

import asyncio
import errno
import os
import resource
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from benchmarks.fleet import Fleet, FleetError, Running
from tests.chaos.processes import family

SIZE = "24m"
BLOCK = bytes(1 << 12)
FILLER = "filler"
_MOUNT = 'mount -t tmpfs -o size="$2" chaos "$1" && echo mounted && exec sleep infinity'


@dataclass
class SmallDisk:
    """A folder with little room."""

    folder: Path
    """Where its users see it."""

    holder: Running | None
    """Keeps the mount alive; None where there is none."""

    @property
    def kind(self) -> str:
        """What makes it full, in words."""
        return "tmpfs" if self.holder else "limit of file sizes"

    @property
    def outside(self) -> Path:
        """Where this process sees it."""
        if self.holder is None:
            return self.folder
        return Path(f"/proc/{self.holder.process.pid}/root{self.folder}")

    def command(self, words: Sequence[str]) -> tuple[str, ...]:
        """Return the command that runs another one where the disk is seen."""
        if self.holder is None:
            return tuple(words)
        pid = str(self.holder.process.pid)
        return ("nsenter", "--preserve-credentials", "--user", "--mount", "-t", pid, *words)

    def fill(self, writer: int) -> None:
        """Leave no room for a process and its children."""
        if self.holder is None:
            _limit(writer, 0)
            return
        with (self.outside / FILLER).open("ab", buffering=0) as filler:
            try:
                while True:
                    filler.write(BLOCK)
            except OSError as error:
                if error.errno != errno.ENOSPC:
                    raise

    def free(self, writer: int) -> None:
        """Make room again."""
        if self.holder is None:
            _limit(writer, resource.RLIM_INFINITY)
        else:
            (self.outside / FILLER).unlink(missing_ok=True)


async def small_disk(fleet: Fleet, folder: Path) -> SmallDisk:
    """Make a small disk in an empty folder; it goes with the fleet."""
    await asyncio.to_thread(folder.mkdir)
    command = (
        *("unshare", "--user", "--map-root-user", "--mount"),
        *("sh", "-c", _MOUNT, "sh", str(folder), SIZE),
    )
    try:
        return SmallDisk(folder, await fleet.start("small disk", command, "mounted"))
    except (FleetError, FileNotFoundError):
        return SmallDisk(folder, None)


def _limit(writer: int, size: int) -> None:
    for pid in family(writer):
        with suppress(ProcessLookupError):
            _, hard = resource.prlimit(pid, resource.RLIMIT_FSIZE)
            soft = hard if size == resource.RLIM_INFINITY else size
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (soft, hard))
    os.sync()
