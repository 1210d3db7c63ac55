"""Entries of the journal, and the chain that ties them together.

Each entry carries the hash of the one before it. An entry that is changed, removed, inserted or
moved breaks the chain at its place. Cutting entries off the end cannot be seen from the chain
alone: compare its head, which `falconer doctor --journal` prints, with one noted elsewhere.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, Final

GENESIS: Final = "0" * 64
"""Stands for the hash before the first entry."""


class EntryKind(StrEnum):
    """What an entry tells of."""

    SERVER = "server"
    """The server started or stopped."""

    MISSION = "mission"
    """A mission was made; the body is its whole definition."""

    STATE = "state"
    """A mission took another state."""

    EVENT = "event"
    """Something a mission told; the body is the stream's message."""

    COMMENT = "comment"
    """A person said something to the models. Committed before it is acknowledged."""

    COMMENT_REFUSED = "comment_refused"
    """The comment did not reach the mission, and whoever said it was told so."""

    OVERRIDE = "override"
    """A person changed directives. Committed, if it can be, before it is acknowledged."""

    SAMPLE = "sample"
    """The figures of one moment: what `history` shows."""

    SCENARIO = "scenario"
    """A scenario was uploaded, or removed again."""

    REQUEST = "request"
    """A person or a program asked for a change, and was answered."""

    SESSION = "session"
    """Somebody logged in, failed to, or logged out."""

    GAP = "gap"
    """Entries were lost, mostly while the database was away; the body says how many."""


@dataclass(frozen=True, slots=True)
class Entry:
    """What is to be written."""

    kind: EntryKind
    mission: str = ""
    """Id of the mission it belongs to, "" for none."""

    author: str = ""
    """Who caused it: a person or a program; "" for the machine itself."""

    time_s: float | None = None
    """Mission time, where there is one."""

    number: int | None = None
    """Of an event or a sample within its mission, from 1."""

    body: Mapping[str, Any] = field(default_factory=dict)
    at: datetime = field(default_factory=lambda: datetime.now(UTC))
    """Wall clock at which it happened."""


@dataclass(frozen=True, slots=True)
class Sealed:
    """An entry in its place in the chain, as the database keeps it."""

    seq: int
    at: str
    """Wall clock, ISO 8601, UTC."""

    mission: str
    number: int | None
    kind: str
    author: str
    time_s: float | None
    body: str
    """JSON, exactly as hashed."""

    previous: str
    hash: str

    @property
    def data(self) -> dict[str, Any]:
        """The body as JSON values."""
        values: dict[str, Any] = json.loads(self.body)
        return values


@dataclass(frozen=True, slots=True)
class Head:
    """The newest entry's place and hash."""

    seq: int = 0
    hash: str = GENESIS


def seal(entry: Entry, head: Head) -> Sealed:
    """Return the entry chained to the one before it.

    Raises ValueError for NaN and infinity, TypeError and RecursionError for what else is no JSON.
    """
    at = entry.at.astimezone(UTC).isoformat(timespec="milliseconds")
    body = json.dumps(dict(entry.body), separators=(",", ":"), allow_nan=False)
    parts = (
        head.seq + 1,
        at,
        entry.mission,
        entry.number,
        entry.kind.value,
        entry.author,
        None if entry.time_s is None else float(entry.time_s),
        body,
        head.hash,
    )
    return Sealed(*parts, hash=_digest(parts))


def is_sound(sealed: Sealed) -> bool:
    """Tell whether an entry's hash is that of its content."""
    parts = (
        sealed.seq,
        sealed.at,
        sealed.mission,
        sealed.number,
        sealed.kind,
        sealed.author,
        sealed.time_s,
        sealed.body,
        sealed.previous,
    )
    return _digest(parts) == sealed.hash


def _digest(parts: tuple[object, ...]) -> str:
    text = json.dumps(parts, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
