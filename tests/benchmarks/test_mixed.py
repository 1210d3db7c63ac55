"""MAVLink vehicles and simulated robots in one live mission, in short; real processes, sockets."""

from typing import Any

import pytest

from benchmarks.mixed import broken, measure
from tests.patience import busy

FINE: dict[str, Any] = {
    "ticks": 100,
    "missed_ticks": 0,
    "refused_on_board": {21: 0, 22: 0},
    "refusals": [],
    "autopilots": {"autopilot 21": [100, 0]},
    "tracked": ["tracked", "tracked"],
}


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_mixed_team_tracks_its_targets() -> None:
    load = busy()
    figures = await measure(10.0, "none")
    load = max(load, busy())
    missed, ticks = figures.pop("missed_ticks"), figures["ticks"]
    assert ticks + missed == pytest.approx(figures["mission_s"] / 0.1, abs=0.5), "none unaccounted"
    assert figures["mission_s"] > 5.0
    assert missed <= 0.2 * load * ticks, "a busy machine may miss some"
    assert broken({**figures, "missed_ticks": 0}) == []
    assert set(figures["setpoints"]) == {21, 22, 23, 24}
    for robot_id, heard in figures["setpoints"].items():
        assert heard > 0
        assert heard >= 0.9 * ticks or robot_id in figures["cut_off"], robot_id
    assert min(counts[0] for counts in figures["autopilots"].values()) >= 0.7 * (ticks + missed)
    assert figures["mean_error_m"] < 0.5
    for modes in figures["modes"].values():
        assert "flying" in modes
        assert set(modes) <= {"flying", "holding", "onboard"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"missed_ticks": 1}, "1 of 100 ticks missed"),
        ({"refused_on_board": {21: 0, 22: 2}}, "refused"),
        ({"refusals": ["robot 21: too fast"]}, "too fast"),
        ({"autopilots": {"autopilot 21": [100, 1]}}, "ignored"),
        ({"autopilots": {"autopilot 21": []}}, "ignored"),
        ({"tracked": ["tracked", "dropped"]}, "dropped"),
    ],
)
def test_a_broken_promise_is_told(change: dict[str, Any], words: str) -> None:
    assert broken(FINE) == []
    (found,) = broken({**FINE, **change})
    assert words in found
