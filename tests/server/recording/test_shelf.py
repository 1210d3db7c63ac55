import os
import shutil
from pathlib import Path

import pytest

from server.recording.errors import RecordingError
from server.recording.shelf import Shelf, free_path
from tests.server.recording.conftest import Flight


def test_what_has_not_changed_is_not_read_again(guided: Flight, tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    shutil.copy(guided[0], tmp_path / "old.mcap")
    (tmp_path / "broken.mcap").write_bytes(b"\x89MCAP0\r\n")
    os.utime(tmp_path / "old.mcap", ns=(1, 1))
    first = shelf.recordings()
    assert [info["name"] for info in first.values()] == ["broken.mcap", "old.mcap"]
    again = shelf.recordings(first)
    assert all(again[stamp] is first[stamp] for stamp in first)
    shutil.copy(guided[0], tmp_path / "broken.mcap")
    mended = shelf.recordings(again)
    assert len(mended) == 2
    assert [info["error"] for info in mended.values()] == [None, None]
    assert next(reversed(mended.values())) is next(reversed(first.values()))


def test_a_folder_that_is_not_there_holds_nothing(tmp_path: Path) -> None:
    assert Shelf(tmp_path / "nowhere").recordings() == {}


@pytest.mark.parametrize("name", ["../x.mcap", ".x.mcap", "x", "x.mcap/../y.mcap", "", "x.mcap\n"])
def test_names_do_not_lead_out(tmp_path: Path, name: str) -> None:
    with pytest.raises(RecordingError, match="no name"):
        Shelf(tmp_path).open(name)


def test_a_taken_name_gets_a_number(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    assert free_path(path) == path
    path.touch()
    assert free_path(path).name == "flight-2.mcap"


def test_a_file_that_has_just_been_removed_is_not_listed(guided: Flight, tmp_path: Path) -> None:
    shutil.copy(guided[0], tmp_path / "here.mcap")
    (tmp_path / "gone.mcap").symlink_to(tmp_path / "nowhere")
    assert [info["name"] for info in Shelf(tmp_path).recordings().values()] == ["here.mcap"]
