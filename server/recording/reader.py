"""Reading a recording, whole or cut off anywhere.

The file is walked once, chunk by chunk, without unpacking; then a chunk is unpacked when it is
asked for. A file without its end (a killed writer, a copy that broke off) is read to its last
whole chunk, and says so.
"""

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final

from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.records import Channel, Chunk, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from pydantic import ValidationError
from zstandard import ZstdError

from server.mission.tape import Entry
from server.recording.errors import RecordingError
from server.recording.header import METADATA_NAME, Header, parse_header
from server.recording.scene import NANOSECONDS
from server.recording.topics import ENTRY, EVENT, SNAPSHOT, TAPE, TRUTH
from vehicles.messages import Truth

Json = dict[str, Any]

MAX_RECORD_BYTES: Final = 64 * 2**20
"""A longer record is not ours: a cut-off length field must not ask for all memory."""

_MAGIC_BYTES: Final = 8

_DAMAGE: Final = (EndOfFile, McapError, ZstdError, struct.error, ValueError)
"""What mcap raises where a file breaks off or its bytes are wrong."""


@dataclass(frozen=True, slots=True)
class _Part:
    """Where a chunk lies in the file, and from when to when it tells."""

    offset: int
    start_ns: int
    end_ns: int


@dataclass(slots=True)
class _Contents:
    """What a walk through the file found."""

    header: Header | None = None
    parts: list[_Part] = field(default_factory=list)
    channels: dict[int, str] = field(default_factory=dict)
    complete: bool = False


class Recording:
    """A recording on disk. Made by `open_recording`.

    Whatever reads raises RecordingError where the file is damaged, or is there no longer.
    """

    def __init__(self, path: Path, contents: _Contents, header: Header) -> None:
        self.path = path
        self.header = header
        self.complete = contents.complete
        """Whether its writer finished it."""

        self._parts = contents.parts
        self._channels = contents.channels

    @property
    def duration_s(self) -> float:
        """Mission time of its end."""
        return max((part.end_ns for part in self._parts), default=0) / NANOSECONDS

    def entries(self) -> Iterator[Entry]:
        """Yield the tape. Raises RecordingError where an entry is not one of ours."""
        for message in self._messages(TAPE):
            try:
                yield ENTRY.validate_json(message.data)
            except ValidationError as error:
                at_s = message.log_time / NANOSECONDS
                raise RecordingError(
                    f"{self.path}: the tape cannot be read at {at_s:g} s:"
                    f" {error.errors(include_url=False)[0]['msg']}"
                ) from None

    def snapshots(self, from_s: float = 0.0, until_s: float | None = None) -> Iterator[Json]:
        """Yield snapshot messages of a span of mission time, oldest first."""
        for message in self._messages(SNAPSHOT, from_s, until_s):
            yield json.loads(message.data)

    def sampled(self, step_s: float) -> Iterator[Json]:
        """Yield the first snapshot of every stretch of mission time, oldest first."""
        next_ns = 0
        for message in self._messages(SNAPSHOT):
            if message.log_time >= next_ns:
                next_ns = message.log_time + round(step_s * NANOSECONDS)
                yield json.loads(message.data)

    def events(self) -> Iterator[Json]:
        """Yield event messages, oldest first."""
        for message in self._messages(EVENT):
            yield json.loads(message.data)

    def snapshot_at(self, time_s: float) -> Json | None:
        """Return the newest snapshot at or before a mission time, None before the first."""
        message = self._newest(SNAPSHOT, time_s)
        return None if message is None else dict(json.loads(message.data))

    def truth_at(self, time_s: float) -> Truth | None:
        """Return the world's truth at or before a mission time, None where none is known."""
        message = self._newest(TRUTH, time_s)
        return None if message is None else Truth.model_validate_json(message.data)

    def _newest(self, topic: str, time_s: float) -> Message | None:
        until_ns = round(time_s * NANOSECONDS)
        for part in reversed(self._parts):
            if part.start_ns > until_ns:
                continue
            found = None
            for message in self._unpacked(part, topic):
                if message.log_time <= until_ns:
                    found = message
            if found is not None:
                return found
        return None

    def _messages(
        self, topic: str, from_s: float = 0.0, until_s: float | None = None
    ) -> Iterator[Message]:
        first_ns = round(from_s * NANOSECONDS)
        last_ns = None if until_s is None else round(until_s * NANOSECONDS)
        for part in self._parts:
            if part.end_ns < first_ns or (last_ns is not None and part.start_ns > last_ns):
                continue
            for message in self._unpacked(part, topic):
                late = last_ns is not None and message.log_time > last_ns
                if message.log_time >= first_ns and not late:
                    yield message

    def _unpacked(self, part: _Part, topic: str) -> Iterator[Message]:
        try:
            with self.path.open("rb") as file:
                file.seek(part.offset)
                reader = StreamReader(file, skip_magic=True, emit_chunks=True)
                chunk = next(iter(reader.records), None)
            if not isinstance(chunk, Chunk):
                raise RecordingError(f"{self.path}: the file changed while it was read")
            records = breakup_chunk(chunk, validate_crc=True)
        except OSError as error:
            words = f"{self.path} cannot be read: {error.strerror or error}"
            raise RecordingError(words) from None
        except _DAMAGE as error:
            raise RecordingError(
                f"{self.path}: it is damaged at {part.start_ns / NANOSECONDS:g} s:"
                f" {str(error) or 'it ends too soon'}"
            ) from None
        for record in records:
            if isinstance(record, Message) and self._channels.get(record.channel_id) == topic:
                yield record


def open_recording(path: Path) -> Recording:
    """Open a recording, whole or cut off.

    Raises:
        RecordingError: There is no such file, it is not a recording of ours, or it was cut off
            before it said which mission it is of.
    """
    try:
        with path.open("rb") as file:
            contents = _walk(file)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from None
    except InvalidMagic:
        raise RecordingError(f"{path}: this is not an MCAP file") from None
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    if contents.header is None:
        kind = "not a recording of Falconer" if contents.complete else "cut off before its header"
        raise RecordingError(f"{path}: this is {kind}")
    return Recording(path, contents, contents.header)


def _walk(file: BinaryIO) -> _Contents:
    """Look at every record once; stop at the first that is not whole."""
    contents = _Contents()
    if len(file.read(_MAGIC_BYTES)) < _MAGIC_BYTES:
        return contents
    file.seek(0)
    reader = StreamReader(file, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES)
    end = _MAGIC_BYTES
    records = iter(reader.records)
    while True:
        try:
            record = next(records, None)
            if record is None:
                contents.complete = True
                return contents
            if isinstance(record, Chunk):
                if not contents.channels:
                    contents.channels = _channels(record)
                contents.parts.append(
                    _Part(end, record.message_start_time, record.message_end_time)
                )
        except InvalidMagic:
            if end == _MAGIC_BYTES:
                raise
            return contents
        except _DAMAGE:
            return contents
        if isinstance(record, Metadata) and record.name == METADATA_NAME:
            contents.header = parse_header(record.metadata)
        end = file.tell()


def _channels(chunk: Chunk) -> dict[int, str]:
    """Return topics by channel id: our writer declares all of them in the first chunk."""
    return {
        record.id: record.topic
        for record in breakup_chunk(chunk, validate_crc=True)
        if isinstance(record, Channel)
    }
