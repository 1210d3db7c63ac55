import csv
from pathlib import Path

import pytest

from server.recording.errors import RecordingError
from server.recording.reader import open_recording
from server.recording.report import render, write_report
from server.recording.summary import summarise
from server.recording.writer import RecordingWriter
from tests.server.recording.conftest import Flight
from tests.server.recording.flown import FOCUS


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_tables_say_what_was_flown(guided: Flight, tmp_path: Path) -> None:
    page, course, events, comments = write_report(open_recording(guided[0]), tmp_path / "out")
    flown = rows(course)
    assert len(flown) == 90
    total = sum(float(row["trace"]) for row in flown)
    assert total == pytest.approx(guided[1]["accumulated_trace"], abs=1e-4)
    assert int(flown[-1]["sensing_attacks"]) == guided[1]["sensing_attacks"]
    (said,) = rows(comments)
    assert said["text"] == FOCUS
    assert said["status"] == "applied"
    assert float(said["trace_before"]) > 0.0
    assert [int(row["seq"]) for row in rows(events)] == list(range(1, len(rows(events)) + 1))
    text = page.read_text("utf-8")
    assert f"{guided[1]['accumulated_trace']:.2f}" in text
    assert text.count("data:image/png;base64,iVBOR") == 3
    assert "http://" not in text
    assert "https://" not in text


def test_what_people_write_cannot_become_markup(guided: Flight) -> None:
    summary = summarise(open_recording(guided[0]))
    summary.comments[0].comment["text"] = "<script>alert(1)</script>"
    page = render(summary)
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert" in page


def test_no_cell_becomes_a_formula(guided: Flight, tmp_path: Path) -> None:
    recording = open_recording(guided[0])
    path = tmp_path / "odd.mcap"
    with RecordingWriter(path, recording.header) as writer:
        for snapshot in recording.snapshots(0.0, 15.0):
            for comment in snapshot["comments"]:
                comment["text"] = '=HYPERLINK("x")'
            writer.tell(snapshot)
    *_, comments = write_report(open_recording(path), tmp_path / "out")
    assert rows(comments)[0]["text"].startswith("'=")


def test_a_cut_recording_is_reported_as_far_as_it_goes(guided: Flight, tmp_path: Path) -> None:
    data = guided[0].read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) * 3 // 4])
    page = write_report(open_recording(cut), tmp_path / "out")[0]
    assert "cut off" in page.read_text("utf-8")
    assert "cut off" not in render(summarise(open_recording(guided[0])))


def test_a_recording_without_snapshots_says_so(guided: Flight, tmp_path: Path) -> None:
    path = tmp_path / "tape.mcap"
    with RecordingWriter(path, open_recording(guided[0]).header):
        pass
    with pytest.raises(RecordingError, match="holds no snapshot"):
        write_report(open_recording(path), tmp_path / "out")
