"""The page on the result names every key of a run's result, and nothing else."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from server.gate.encoding import with_decisions
from server.gate.keeper import Gatekeeper
from server.mission.core import MissionCore
from server.mission.tape import NoTape, TapedCore
from server.result import LoopTally, RunTally, WorldFigures, receipt_json, result_json
from server.scenarios import library
from solver.directives import CommentVerdict
from solver.observations import Comment
from solver.snapshot import CommentReceipt
from tests.house.documents import CODE

BY_ID = ("assignment", "weights", "rungs", "refused", "decisions")
"""Objects whose keys are data, or documented elsewhere; documented as one key."""


def _keys(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for name, item in value.items():
            yield name
            if name not in BY_ID:
                yield from _keys(item)
    elif isinstance(value, list):
        for item in value:
            yield from _keys(item)


def test_every_key_of_the_result_is_documented_and_exists(root: Path) -> None:
    page = (root / "docs" / "reference" / "result.md").read_text("utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    documented = {code for row in rows for code in CODE.findall(row)} - {"null"}
    setup = library.load("ablation").mission_setup()
    core = TapedCore(MissionCore(setup), NoTape())
    last = core.snapshot
    world = WorldFigures(0, 0, 0.0, None)
    result = result_json(setup, last, RunTally(), world, LoopTally(), LoopTally(), 0.0)
    comment = Comment("c1", "Look after target 1.", 0.0, 120.0)
    result["comments"].append(receipt_json(CommentReceipt(comment, task=CommentVerdict.NOTED)))
    result = with_decisions(result, Gatekeeper(core, setup.gate), [])
    assert documented == set(_keys(result))
