"""A real live mission of a few seconds, and what is made of its reports."""

import asyncio
from dataclasses import replace

import pytest

from server.api.definitions import define_live
from server.experiments.runtime import PAPER, Flight, FlightFailed, fly, table
from server.scenarios import library
from server.settings import load_settings

FLIGHT = Flight(
    scenario="hardware",
    llm="mock",
    duration_s=60.0,
    loops={
        "optimizer": {
            "rate_hz": 10.0, "mean_s": 0.004, "success_rate": 1.0, "adopted_rate": None,
            "calls": 600, "missed": 2,
        },
        "task_llm": {
            "rate_hz": None, "mean_s": 1.2, "success_rate": 1.0, "adopted_rate": 0.5,
            "calls": 2, "missed": 0,
        },
    },
    result={"optimizer": {"median_ms": 0.25, "success_rate": 0.99, "ticks": 600}},
)  # fmt: skip


def test_the_table_sets_our_modules_beside_the_papers() -> None:
    rows = {row["module"]: row for row in table(FLIGHT).records()}
    assert rows["task LLM"]["rate_hz"] is None
    assert rows["task LLM"]["success"] == 100.0
    assert rows["task LLM"]["adopted"] == 50.0
    assert rows["optimizer, whole tick"]["missed"] == 2
    assert rows["optimizer, solve alone"]["mean_s"] == pytest.approx(0.00025)
    assert rows["optimizer, solve alone"]["success"] == pytest.approx(99.0)
    assert rows["action LLM"].get("mean_s") is None, "it did not run"
    assert rows["action LLM"]["paper_s"] == PAPER["action_llm"][1]


@pytest.mark.process
def test_a_live_mission_is_flown_and_both_processes_end() -> None:
    setup = library.named("hardware").mission_setup()
    world = library.named("hardware").world_setup()
    definition = define_live(replace(setup, steps=10_000), world, "mock", load_settings())
    seconds: list[int] = []
    flight = asyncio.run(fly(definition, 3.0, seconds.append))
    assert seconds == [1, 2, 3]
    assert flight.loops["optimizer"]["calls"] >= 10
    assert flight.loops["action_llm"]["calls"] >= 1
    assert flight.result["optimizer"]["ticks"] >= 10
    assert {row["module"] for row in table(flight).records()} >= {"task LLM", "action LLM"}


@pytest.mark.process
def test_a_mission_that_ends_too_early_is_told_of() -> None:
    setup = library.named("hardware").mission_setup()
    world = library.named("hardware").world_setup()
    short = replace(setup, tick_s=0.1, steps=5)
    definition = define_live(short, world, "none", load_settings())
    with pytest.raises(FlightFailed, match="broke off"):
        asyncio.run(fly(definition, 30.0, lambda _: None))
