"""The folder of recordings: what lies in it, and names that cannot lead out of it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from server.recording.errors import RecordingError
from server.recording.header import header_summary
from server.recording.reader import Recording, open_recording

NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,120}\.mcap")

Info = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Stamp:
    """A file as it was at some time: another stamp, another content."""

    name: str
    size_bytes: int
    changed_ns: int


@dataclass(frozen=True, slots=True)
class Shelf:
    """Recordings by name. Blocks: call it in a thread."""

    folder: Path

    def recordings(self, known: Mapping[Stamp, Info] | None = None) -> dict[Stamp, Info]:
        """Return every recording, newest first; what cannot be read says why.

        Those in `known`, the answer to an earlier call, are not read again unless they changed.
        """
        if not self.folder.is_dir():
            return {}
        found = [path for path in self.folder.iterdir() if NAME.fullmatch(path.name)]
        stamps = {stamp: path for path in found if (stamp := _stamp(path)) is not None}
        known = known or {}
        return {
            stamp: known[stamp] if stamp in known else _info(stamps[stamp], stamp)
            for stamp in sorted(stamps, key=lambda stamp: stamp.changed_ns, reverse=True)
        }

    def open(self, name: str) -> Recording:
        """Open a recording by name. Raises RecordingError."""
        if not NAME.fullmatch(name):
            raise RecordingError(f"{name[:60]!r} is no name of a recording")
        return open_recording(self.folder / name)


def free_path(path: Path) -> Path:
    """Return a path that is not taken: itself, or the first with a number behind its stem."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free


def _stamp(path: Path) -> Stamp | None:
    """Return a file as it is, None for one that was removed a moment ago."""
    try:
        known = path.stat()
    except FileNotFoundError:
        return None
    return Stamp(path.name, known.st_size, known.st_mtime_ns)


def _info(path: Path, stamp: Stamp) -> Info:
    size = stamp.size_bytes
    try:
        recording = open_recording(path)
    except RecordingError as error:
        return {"name": path.name, "size_bytes": size, "error": str(error).split(": ", 1)[-1]}
    return {
        "name": path.name,
        "size_bytes": size,
        "error": None,
        "duration_s": recording.duration_s,
        "complete": recording.complete,
        **header_summary(recording.header),
    }
