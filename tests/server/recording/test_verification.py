from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from server.mission.tape import Committed, Entry
from server.recording.header import Header
from server.recording.reader import Recording, open_recording
from server.recording.verification import verify_recording
from server.recording.writer import RecordingWriter
from tests.server.recording.conftest import Flight


def rewritten(source: Recording, path: Path, change: object) -> Recording:
    header: Header = source.header
    with RecordingWriter(path, header) as writer:
        for entry in change(source.entries()):  # type: ignore[operator]
            writer.write(entry)
    return open_recording(path)


def test_a_recording_gives_its_setpoints_and_directives_again(guided: Flight) -> None:
    seen: list[float] = []
    found = verify_recording(open_recording(guided[0]), seen.append)
    assert found.passed
    assert (found.ticks, found.different, found.differences) == (90, 0, [])
    assert seen[-1] == 45.0


def test_one_bit_of_one_setpoint_is_noticed(guided: Flight, tmp_path: Path) -> None:
    def bent(entries: Iterator[Entry]) -> Iterator[Entry]:
        for count, entry in enumerate(entries):
            if isinstance(entry, Committed) and count > 200:
                first, *rest = entry.setpoints
                x, y = first.velocity
                first = replace(first, velocity=(x + 2.0**-52 * max(abs(x), 1.0), y))
                entry = replace(entry, setpoints=(first, *rest))
            yield entry

    found = verify_recording(
        rewritten(open_recording(guided[0]), tmp_path / "bent.mcap", bent), lambda s: None
    )
    assert not found.passed
    assert found.different > 0
    assert "velocities differ by up to" in found.differences[0]


def test_a_missing_input_is_noticed(guided: Flight, tmp_path: Path) -> None:
    def without_one(entries: Iterator[Entry]) -> Iterator[Entry]:
        for count, entry in enumerate(entries):
            if not (count > 100 and entry.kind == "proposed"):
                yield entry

    found = verify_recording(
        rewritten(open_recording(guided[0]), tmp_path / "less.mcap", without_one), lambda s: None
    )
    assert "directives" in "; ".join(found.differences)


def test_an_empty_recording_proves_nothing(guided: Flight, tmp_path: Path) -> None:
    empty = rewritten(open_recording(guided[0]), tmp_path / "empty.mcap", lambda e: ())
    assert not verify_recording(empty, lambda s: None).passed
