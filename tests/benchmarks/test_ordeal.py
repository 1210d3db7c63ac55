"""A disturbed flight is recorded and verified, in short; `benchmarks.ordeal` flies ten minutes."""

import copy
from pathlib import Path
from typing import Any

import pytest

from benchmarks.ordeal import CUTS, LEAST_TICKS, broken, measure
from llm.mock.behaviours import Mode

FINE: dict[str, Any] = {
    "flight": {
        "comments": 2, "attacks": 3, "holds": 2, "lost_robots": [21], "refused": {"parsing": 1},
    },
    "verification": {"exit_code": 0, "passed": True, "ticks": 9, "different": 0, "complete": True},
    "cuts": {"cuts": CUTS, "opened": CUTS - 1, "refused_within_header": 1},
}  # fmt: skip


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_disturbed_live_mission_replays_bit_for_bit(tmp_path: Path) -> None:
    figures = await measure(tmp_path, 14.0, (Mode.GARBAGE, Mode.SOUND))
    figures["flight"]["attacks"] = figures["flight"]["attacks"] or "in so short a flight, chance"
    assert broken(figures) == []
    assert figures["flight"]["lost_robots"] == [21]
    assert figures["verification"]["ticks"] >= LEAST_TICKS
    assert figures["cuts"]["opened"] > 0


@pytest.mark.parametrize(
    ("part", "change", "words"),
    [
        ("flight", {"comments": 0}, "no comments"),
        ("flight", {"lost_robots": []}, "no lost_robots"),
        ("flight", {"refused": {"gate": 3}}, "never failed"),
        ("verification", {"passed": False, "different": 4}, "4 of 9 ticks differ"),
        ("verification", {"complete": False}, "not finished"),
        ("cuts", {"opened": CUTS - 2}, "not every piece"),
    ],
)
def test_a_broken_promise_is_told(part: str, change: dict[str, Any], words: str) -> None:
    assert broken(FINE) == []
    changed = copy.deepcopy(FINE)
    changed[part] |= change
    (found,) = broken(changed)
    assert words in found
