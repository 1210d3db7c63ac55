"""The server is killed at random moments of a live mission; `benchmarks.crashes` does it often."""

from pathlib import Path

import pytest

from benchmarks.crashes import campaign


@pytest.mark.process
@pytest.mark.timeout(400)
@pytest.mark.asyncio
async def test_nothing_acknowledged_is_lost_when_the_server_is_killed(tmp_path: Path) -> None:
    async with campaign("hardware", tmp_path, seed=2) as killed:
        for _ in range(3):
            await killed.round()
        assert killed.comments
