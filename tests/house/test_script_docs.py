"""The page on scripts names every field of one, and nothing else."""

from collections.abc import Iterator
from pathlib import Path

from server.scripts.script import Do, Mission, Say, Script
from tests.house.documents import CODE, first_cells, sections


def _fields() -> Iterator[str]:
    for name in Script.model_fields:
        if name == "actions":
            for action in (Say, Do):
                yield from (f"actions[].{each}" for each in action.model_fields)
        else:
            yield name


def test_every_field_of_a_script_is_documented_and_exists(root: Path) -> None:
    page = (root / "docs" / "guides" / "headless.md").read_text("utf-8")
    section = sections(page, 2)["Scripts"]
    documented = {code for cell in first_cells(section) for code in CODE.findall(cell)}
    assert documented == set(_fields())
    assert set(Mission.model_fields) <= set(CODE.findall(section))
