import errno
import threading
from pathlib import Path
from typing import Any

import pytest

from server.mission.tape import Began, Observed
from server.recording import writer as module
from server.recording.errors import RecordingError
from server.recording.reader import open_recording
from server.recording.writer import RecordingWriter, opened_writer
from solver.observations import Detections, Sighting
from tests.server.recording.conftest import Flight


def test_nothing_is_overwritten(guided: Flight) -> None:
    header = open_recording(guided[0]).header
    before = guided[0].read_bytes()
    with (
        pytest.raises(RecordingError, match="exists already"),
        opened_writer(guided[0], header, print),
    ):
        raise AssertionError("opened")
    assert guided[0].read_bytes() == before


def test_a_folder_that_cannot_be_made_is_told(guided: Flight, tmp_path: Path) -> None:
    header = open_recording(guided[0]).header
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(RecordingError, match="cannot be written"),
        opened_writer(tmp_path / "file" / "x.mcap", header, print),
    ):
        raise AssertionError("opened")


def test_every_bit_survives_nan_and_infinity_too(guided: Flight, tmp_path: Path) -> None:
    header = open_recording(guided[0]).header
    odd = Observed(Detections(7, (0.1 + 0.2, 5e-324), (Sighting(3, float("inf"), -0.0),)))
    with RecordingWriter(tmp_path / "x.mcap", header) as writer:
        writer.write(odd)
        writer.write(Observed(Detections(7, (float("nan"), 1.0), ())))
    first, second = open_recording(tmp_path / "x.mcap").entries()
    assert repr(first) == repr(odd)
    assert "nan" in repr(second)


class FullDisk:
    """A file that takes so many bytes."""

    def __init__(self, file: Any, room: int) -> None:
        self._file = file
        self._room = room

    def write(self, data: bytes) -> int:
        self._room -= len(data)
        if self._room < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return int(self._file.write(data))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __enter__(self) -> "FullDisk":
        return self

    def __exit__(self, *exception: object) -> None:
        self._file.close()


def test_a_full_disk_ends_the_recording_and_nothing_else(
    guided: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    header = open_recording(guided[0]).header
    path = tmp_path / "x.mcap"
    told: list[str] = []
    opened = Path.open

    def limited(self: Path, mode: str = "r", *rest: Any) -> Any:
        file = opened(self, mode, *rest)
        return FullDisk(file, 60_000) if mode == "xb" else file

    monkeypatch.setattr(Path, "open", limited)
    monkeypatch.setattr(module, "CHUNK_BYTES", 1024)
    with RecordingWriter(path, header, told.append) as writer:
        for tick in range(4000):
            writer.write(Began(0.1 * tick))
    monkeypatch.undo()
    assert told == ["The recording ends here: No space left on device. The mission flies on."]
    assert writer.failure == "No space left on device"
    kept = list(open_recording(path).entries())
    assert 0 < len(kept) < 4000
    assert kept == [Began(0.1 * tick) for tick in range(len(kept))]


def test_a_disk_that_is_too_slow_is_not_waited_for(
    guided: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    header = open_recording(guided[0]).header
    told: list[str] = []
    stuck = threading.Event()
    monkeypatch.setattr(module, "MAX_WAITING", 10)
    monkeypatch.setattr(
        RecordingWriter, "_encoded", lambda self, item: (stuck.wait(10.0) and []) or []
    )
    with RecordingWriter(tmp_path / "x.mcap", header, told.append) as writer:
        for tick in range(100):
            writer.write(Began(0.1 * tick))
        assert told == ["The recording ends here: the disk cannot keep up. The mission flies on."]
        stuck.set()
