import json
from pathlib import Path

import pytest

from server.experiments.store import StoreError, TrialStore
from tests.server.experiments.fakes import Counted


def _store(folder: Path) -> TrialStore:
    store = TrialStore(folder)
    store.open()
    return store


def test_a_result_is_found_again_and_only_by_its_own_trial(tmp_path: Path) -> None:
    store = _store(tmp_path / "deep" / "out")
    trial = Counted("a", tmp_path)
    assert store.load(trial) is None
    store.save(trial, {"value": 2.0})
    assert store.load(trial) == {"value": 2.0}
    assert store.load(Counted("a", tmp_path, value=3.0)) is None
    kept = json.loads(store.path_of(trial).read_text())
    assert kept["identity"] == {"name": "a", "value": 1.0}
    assert [path.name for path in store.path_of(trial).parent.iterdir()] == [
        store.path_of(trial).name
    ], "no rough file is left"


@pytest.mark.parametrize(
    "content", ["", '{"result": {"value"', "[]", '{"result": 3}', "{}", "\x00"]
)
def test_a_damaged_file_counts_as_none(tmp_path: Path, content: str) -> None:
    store = _store(tmp_path)
    trial = Counted("a", tmp_path)
    store.path_of(trial).write_text(content)
    assert store.load(trial) is None


def test_a_folder_that_cannot_be_made_is_told_of_at_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StoreError, match="--out"):
        TrialStore(tmp_path / "file").open()


def test_figures_that_are_no_numbers_are_not_kept(tmp_path: Path) -> None:
    store = _store(tmp_path)
    trial = Counted("a", tmp_path)
    with pytest.raises(ValueError, match="JSON"):
        store.save(trial, {"value": float("nan")})
    assert store.load(trial) is None
