"""The program that measures the whole chain over team size, in small."""

import re
from pathlib import Path

import pytest

from benchmarks import scale


@pytest.mark.timeout(900)
@pytest.mark.asyncio
async def test_every_stage_is_measured_and_what_it_sends_counted(tmp_path: Path) -> None:
    found = await scale.flown(8, 16, 4)
    assert set(found.median_ms) == {*scale.STAGES, "tick"}
    assert all(0.0 < found.median_ms[name] <= found.p99_ms[name] for name in ("solve", "tick"))
    assert found.tick_ms >= max(found.median_ms[name] for name in ("hear", "estimate", "snapshot"))
    assert 0 < found.bytes_knowledge < 10_000
    assert found.bytes_snapshot > found.bytes_up > found.bytes_down > 1000
    assert found.prompt_chars > 1000
    text = scale.table([found])
    assert "**all of it**" in text
    scale.draw(tmp_path / "scale.svg", [found])
    assert "<svg" in (tmp_path / "scale.svg").read_text()


def test_the_page_has_a_row_for_every_stage(root: Path) -> None:
    page = (root / "docs" / "scale.md").read_text("utf-8")
    rows = re.findall(r"^\| ([^|]+) \|", page, re.MULTILINE)
    assert set(scale.WORDS.values()) <= set(rows)
