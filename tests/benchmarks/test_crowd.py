"""The crowd at one server, small and short: everybody is served, and the stalled hold up nobody."""

from pathlib import Path

import pytest

from benchmarks.crowd.measure import Crowd, Figures, measure

pytestmark = [pytest.mark.process]

SMALL = Crowd(streams=8, consoles=2, scenes=1, seconds=5.0, settle_s=1.0)


@pytest.mark.asyncio
async def test_everybody_is_served_beside_some_that_stall(tmp_path: Path) -> None:
    figures = await measure("hardware", SMALL, tmp_path, ("--llm", "none"), lambda words: None)
    assert figures.ended == []
    assert set(figures.dropped_s) == {"stream", "console", "scene"}
    assert figures.ticks > 5
    assert 0.0 < figures.age_p50_ms <= figures.age_p99_ms
    assert figures.least_hz > 0.0
    assert figures.console_hz > 0.0
    assert figures.scene_hz > 0.0
    assert figures.alone is not None
    assert figures.end is not None
    # The stalled one too, until it is dropped.
    assert figures.end.streams == figures.alone.streams + SMALL.streams + 1
    assert figures.end.handles > figures.alone.handles


def test_what_is_beyond_the_bar_is_named() -> None:
    figures = Figures(SMALL, ticks=50, missed=2, age_p99_ms=151.0, ended=["stream: gone"])
    assert figures.problems() == [
        "stream: gone",
        "2 ticks were missed",
        "the age of snapshots has a p99 of 151 ms",
    ]
    long = Figures(Crowd(), dropped_s={"console": None, "stream": 12.0})
    assert long.problems() == ["console: never dropped"]
