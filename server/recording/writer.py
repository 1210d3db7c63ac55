"""Writing a recording beside a mission that must not wait for it.

What is to be kept is handed over in order and without waiting; a thread encodes it and
writes it, a chunk a second: whatever ends the process, the file is readable to its last whole
chunk. A tape with a hole could not be replayed, so where the disk fails or cannot
keep up the recording ends there, says why, and the mission flies on.
"""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Full, Queue
from typing import Any, BinaryIO, Final

import structlog
from mcap.writer import Writer

from server.mission.tape import Began, Entry
from server.recording.errors import RecordingError
from server.recording.header import METADATA_NAME, Header, header_metadata
from server.recording.scene import NANOSECONDS, log_message, scene_update
from server.recording.topics import ENTRY, EVENT, LOG, SCENE, SNAPSHOT, TAPE, TRUTH, topics
from vehicles.messages import Truth

log = structlog.get_logger(__name__)

CHUNK_BYTES: Final = 256 * 1024
"""Before compression. A chunk ends earlier when it is `FLUSH_S` old."""

MAX_WAITING: Final = 50_000
"""Items that may wait for the disk: about half a minute of a large team."""

FLUSH_S: Final = 1.0
CLOSE_S: Final = 30.0
"""Longest wait for the last chunk when a recording is closed."""

_SCENE_EVERY: Final = 2
"""Snapshots per scene message: five pictures a second say as much as ten, at half the bytes."""

_END: Final = object()

Report = Callable[[str], None]


class RecordingWriter:
    """One recording being written. Use it as a context; on leaving the file is finished.

    Safe to call from one thread. Implements `server.mission.tape.Recorder`.

    Args:
        path: The file. It must not exist; its folder is made.
        header: What is flown.
        report: Told once, from the writing thread, why the recording has ended early.

    Raises (on entering):
        OSError: The file cannot be made.
    """

    def __init__(self, path: Path, header: Header, report: Report = log.error) -> None:
        self.path = path
        self._header = header
        self._report = report
        self._queue: Queue[Any] = Queue(maxsize=MAX_WAITING)
        self._broken: str | None = None
        self._time_ns = 0
        self._snapshots = 0
        self._thread: threading.Thread | None = None

    def __enter__(self) -> "RecordingWriter":
        self.path.parent.mkdir(parents=True, exist_ok=True)
        file = self.path.open("xb")
        self._thread = threading.Thread(
            target=self._work, args=(file,), name="recording", daemon=True
        )
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def failure(self) -> str | None:
        """Why the recording ended early, None while all is well."""
        return self._broken

    def close(self) -> None:
        """Write what waits and finish the file. Blocks, at most `CLOSE_S`."""
        if self._thread is None:
            return
        with suppress(Full):
            self._queue.put(_END, timeout=CLOSE_S)
        self._thread.join(CLOSE_S)
        if self._thread.is_alive():
            log.error("the recording does not end", path=str(self.path))
        self._thread = None

    # ------------------------------------------------------------------ what is handed over

    def write(self, entry: Entry) -> None:
        """Take the next entry of the tape. Never waits."""
        self._put(entry)

    def tell(self, message: dict[str, Any]) -> None:
        """Take a message of the stream; only snapshots and events are kept. Never waits."""
        self._put(message)

    def truth(self, truth: Truth) -> None:
        """Take what a simulated world really is. Never waits."""
        self._put(truth)

    def _put(self, item: object) -> None:
        if self._broken is not None or self._thread is None:
            return
        try:
            self._queue.put_nowait(item)
        except Full:
            self._break("the disk cannot keep up")

    def _break(self, reason: str) -> None:
        if self._broken is None:
            self._broken = reason
            self._report(f"The recording ends here: {reason}. The mission flies on.")

    # ------------------------------------------------------------------ the thread

    def _work(self, file: BinaryIO) -> None:
        try:
            with file:
                self._write_all(file)
        except OSError as error:
            self._break(error.strerror or str(error))
        except Exception as error:
            log.exception("the recording failed")
            self._break(f"{type(error).__name__}: {error}")

    def _write_all(self, file: BinaryIO) -> None:
        writer = Writer(file, chunk_size=CHUNK_BYTES)
        writer.start(profile="", library="falconer")
        writer.add_metadata(METADATA_NAME, header_metadata(self._header))
        channels = {}
        for topic in topics():
            schema_id = writer.register_schema(topic.schema_name, "jsonschema", topic.schema_bytes)
            channels[topic.name] = writer.register_channel(topic.name, "json", schema_id)
        flushed_s = time.monotonic()
        while True:
            item = self._queue.get()
            if item is _END or self._broken is not None:
                break
            for name, data in self._encoded(item):
                writer.add_message(channels[name], self._time_ns, data, self._time_ns)
            if time.monotonic() - flushed_s >= FLUSH_S:
                writer.flush()  # type: ignore[no-untyped-call]
                flushed_s = time.monotonic()
        writer.finish()  # type: ignore[no-untyped-call]

    def _encoded(self, item: Any) -> list[tuple[str, bytes]]:
        """Return what an item comes to, by topic; mission time goes on with each tick."""
        if isinstance(item, Truth):
            return [(TRUTH, item.model_dump_json().encode())]
        if isinstance(item, dict):
            return self._told(item)
        if isinstance(item, Began):
            self._time_ns = max(self._time_ns, round(item.now_s * NANOSECONDS))
        return [(TAPE, ENTRY.dump_json(item))]

    def _told(self, message: dict[str, Any]) -> list[tuple[str, bytes]]:
        if message["type"] == "event":
            return [(EVENT, _json(message)), (LOG, _json(log_message(message)))]
        if message["type"] != "snapshot":
            return []  # meant for the server alone
        found = [(SNAPSHOT, _json(message))]
        if self._snapshots % _SCENE_EVERY == 0:
            found.append((SCENE, _json(scene_update(message))))
        self._snapshots += 1
        return found


@contextmanager
def opened_writer(path: Path, header: Header, report: Report) -> Iterator[RecordingWriter]:
    """Open a recording to be written. Raises RecordingError when the file cannot be made."""
    if path.exists():
        raise RecordingError(f"{path} exists already; a recording never overwrites")
    try:
        writer = RecordingWriter(path, header, report).__enter__()
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {error.strerror or error}") from None
    try:
        yield writer
    finally:
        writer.close()


def _json(value: dict[str, Any]) -> bytes:
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode()
