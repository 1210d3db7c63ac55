"""The model misbehaves in every way during one live run: real processes, real HTTP, real time."""

import asyncio
import time
from typing import Any

import pytest

from benchmarks.live import Watch, outside
from benchmarks.misbehaviour import HARMLESS, WAYS, hasty, provoke, refusals
from llm.mock.behaviours import Mode
from server.scenarios import library
from server.settings import Settings

LONGEST_S = 60.0
"""After so long a way counts as not noticed."""

QUIET_S = 3.0
TOLERANCE = 0.15
"""Of the ticks. A loop that waited for one slow reply a second would miss far more."""


def noticed(watch: Watch, mode: Mode, first: int, began_s: float) -> bool:
    """Return whether both loops have met a way of misbehaving."""
    lasted_s = time.monotonic() - began_s
    if lasted_s > LONGEST_S:
        return True
    if mode is Mode.SOUND:
        return lasted_s > QUIET_S
    since = [said for _, said in watch.told[first:]]
    if mode in HARMLESS:
        calls = [_calls(said) for said in since if said["type"] == "snapshot"]
        return bool(calls) and all(calls[-1][loop] >= calls[0][loop] + 2 for loop in calls[0])
    told = refusals([said for said in since if said["type"] == "event"])
    return {"task", "action"} <= {each["loop"] for each in told}


def _calls(said: dict[str, Any]) -> dict[str, int]:
    return {name: report["calls"] for name, report in said["loops"].items() if "llm" in name}


@pytest.mark.process
@pytest.mark.timeout(600)
def test_whatever_the_model_does_the_ticks_go_on_and_nothing_leaves_its_bounds() -> None:
    scenario = library.named("hardware")
    settings = Settings(engine="sqp")  # needs no compilation
    setup = hasty(scenario.mission_setup("sqp"), 0.5)
    trial = asyncio.run(provoke(setup, scenario.world_setup(), settings, noticed, delay_s=0.5))
    assert {stretch.mode for stretch in trial.stretches} == set(Mode) == set(WAYS)
    assert trial.outside == ()
    for stretch in trial.stretches:
        assert stretch.mode in HARMLESS or stretch.refused >= 2, stretch
    # A try that was sound at its arrival may still be refused when it is decided.
    assert trial.journalled >= trial.refused > 2 * len(set(WAYS) - HARMLESS)
    assert trial.unexplained == 0
    # Beside the same flight with a sound model: a loaded machine may cost ticks, a model none.
    assert sum(stretch.ticks.ticks for stretch in trial.stretches) > 150
    assert trial.missed_share(sound=False) <= trial.missed_share(sound=True) + TOLERANCE, trial


def said(**directives: Any) -> dict[str, Any]:
    sound = {
        "weights": {"tracking": 5.0},
        "weight_bounds": {"tracking": [0.5, 50.0]},
        "severities": {},
        "capacities": {"21": 2, "26": 2},
        "assignment": {"21": [122], "26": [124]},
    }
    return {
        "directives": sound | directives,
        "targets": [{"id": 122}, {"id": 124}],
        "robots": [{"link": "connected"}, {"link": "jammed"}],
    }


@pytest.mark.parametrize(
    ("directives", "wrong"),
    [
        ({}, False),
        ({"weights": {"tracking": 51.0}}, True),
        ({"weights": {"tracking": None}}, True),
        ({"severities": {"s1": 5.5}}, True),
        ({"severities": {"s1": 5.0}}, False),
        ({"assignment": {"21": [122, 124, 122], "26": []}}, True),
        ({"assignment": {"21": [122], "26": []}}, True),
        ({"assignment": {"21": [122, 7], "26": [124]}}, True),
    ],
)
def test_what_is_outside_is_noticed(directives: dict[str, Any], wrong: bool) -> None:
    assert bool(outside(said(**directives))) is wrong
