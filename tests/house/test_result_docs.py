"""The page on commands names every key of a run's result, and nothing else."""

from pathlib import Path

from server.result import LoopTally, RunTally, WorldFigures, result_json
from server.scenarios import library
from tests.house.documents import CODE, sections


def test_every_key_of_the_result_is_documented_and_exists(root: Path) -> None:
    page = (root / "docs" / "reference" / "cli.md").read_text("utf-8")
    rows = [line for line in sections(page, 3)["The result"].splitlines() if line.startswith("| `")]
    documented = {code for row in rows for code in CODE.findall(row)} - {"null"}
    world = WorldFigures(0, 0, 0.0, None)
    setup = library.load("ablation").mission_setup()
    result = result_json(setup, RunTally(), world, LoopTally(), LoopTally(), 0.0)
    parts = [result[name] for name in ("optimizer", "task_llm", "action_llm")]
    assert documented == set(result).union(*parts)
