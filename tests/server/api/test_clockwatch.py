"""A wall clock that jumps is told of, once for each jump."""

import asyncio
from dataclasses import dataclass, field

import pytest

from server.api.clockwatch import ClockWatch
from tests.server.waiting import eventually


@dataclass
class Clocks:
    """Two clocks that are set by hand, and what was told of them."""

    wall_s: float = 1.7e9
    monotonic_s: float = 50.0
    told: list[str] = field(default_factory=list)

    def watch(self) -> ClockWatch:
        return ClockWatch(self.told.append, lambda: self.wall_s, lambda: self.monotonic_s)

    def go(self, seconds: float) -> None:
        self.wall_s += seconds
        self.monotonic_s += seconds


def test_clocks_that_go_together_are_not_worth_a_word() -> None:
    clocks = Clocks()
    watch = clocks.watch()
    for seconds in (0.0, 1.0, 1.0, 600.0, 1.0):
        clocks.go(seconds)
        clocks.wall_s += 0.5
        watch.look()
    assert clocks.told == []


@pytest.mark.parametrize(("jump_s", "way"), [(3600.0, "forward"), (-90.0, "back")])
def test_a_jump_is_told_once_and_the_way_back_as_another(jump_s: float, way: str) -> None:
    clocks = Clocks()
    watch = clocks.watch()
    watch.look()
    clocks.wall_s += jump_s
    for _ in range(3):
        clocks.go(1.0)
        watch.look()
    assert len(clocks.told) == 1
    assert f"was set {way} by {abs(jump_s):.0f} s" in clocks.told[0]
    clocks.wall_s -= jump_s
    watch.look()
    assert len(clocks.told) == 2


@pytest.mark.asyncio
async def test_it_looks_for_ever_until_it_is_cancelled() -> None:
    clocks = Clocks()
    watching = asyncio.create_task(clocks.watch().run())
    await asyncio.sleep(0)
    clocks.wall_s += 60.0
    await eventually(lambda: bool(clocks.told))
    watching.cancel()
    await asyncio.gather(watching, return_exceptions=True)
    assert len(clocks.told) == 1
