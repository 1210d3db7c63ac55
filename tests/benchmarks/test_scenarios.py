"""The scenarios that defaults are chosen on, beside the paper's: sound, and worth flying."""

from pathlib import Path

import pytest

from benchmarks.flights import Job, fly
from server.mission.setup import Compat
from server.scenarios import library

FILES = sorted((Path(__file__).parents[2] / "benchmarks" / "scenarios").glob("*.yaml"))


def test_there_are_several_of_them() -> None:
    assert len(FILES) >= 3


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_each_can_be_flown(path: Path) -> None:
    scenario = library.load(str(path))
    assert scenario.name == path.stem
    assert scenario.compat is Compat.NONE
    assert scenario.zones
    run = fly(Job(str(path), 1, (("steps", 40),)))
    assert run.trace > 0.0
    assert run.position_error_m < 0.6
    assert run.closest_m is None
