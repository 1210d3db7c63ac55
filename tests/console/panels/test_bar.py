import re
from typing import Any

import pytest

from console.panels import bar
from tests.console.messages import message
from tests.console.reading import words


@pytest.mark.parametrize(
    ("name", "changes", "level"),
    [
        ("task_llm", {"calls": 0}, "idle"),
        ("task_llm", {"age_s": 25.0}, "ok"),
        ("task_llm", {"age_s": 61.0}, "alarm"),
        ("task_llm", {"age_s": 61.0, "rate_hz": 1.0 / 60.0}, "ok"),
        ("task_llm", {"age_s": 181.0, "rate_hz": 1.0 / 60.0}, "alarm"),
        ("task_llm", {"age_s": 61.0, "rate_hz": None}, "alarm"),
        ("task_llm", {"age_s": None}, "alarm"),
        ("task_llm", {"success_rate": 0.5}, "warn"),
        ("action_llm", {"age_s": 29.0, "waits_for_person": True}, "warn"),
        ("action_llm", {"age_s": 29.0, "waits_for_person": False}, "alarm"),
        ("optimizer", {"age_s": 0.0}, "ok"),
        ("optimizer", {"age_s": 4.0}, "alarm"),
    ],
)
def test_a_lamp_tells_how_a_loop_does(name: str, changes: dict[str, Any], level: str) -> None:
    loop = {
        "rate_hz": 1.0,
        "mean_s": 1.0,
        "success_rate": 1.0,
        "age_s": 1.0,
        "calls": 9,
        "missed": 0,
    }
    assert bar.loop_level(name, loop | changes) == level


def test_a_lamp_tells_valid_answers_from_those_that_went_into_force() -> None:
    snapshot = message()
    snapshot["loops"]["task_llm"] |= {"success_rate": 1.0, "adopted_rate": 0.25}
    told = bar.lamps(snapshot)
    assert "100 %" in words(told)
    assert "25 % of the answers went into force" in told


def test_lamps_name_all_three_loops() -> None:
    assert words(bar.lamps(message())) == (
        "Optimizer 10.0 Hz · 100 % Task model 10 s ago · 100 % Action model 0 s ago · 80 %"
    )


def test_a_silent_planner_has_no_lamp_that_passes_for_well() -> None:
    told = bar.lamps(message(), 7.2)
    assert words(told) == ("Optimizer silent for 7 s Task model not known Action model not known")
    assert re.findall('class="lamp (\\w+)"', told) == ["alarm", "idle", "idle"]
    assert "stale" in bar.mission_clock(message(), 7.2)
    assert "11 s old" in bar.guidance(message(), 7.6)  # and 3.2 s when it spoke
    assert bar.mission_clock(message(), 0.0) == words(bar.mission_clock(message(), 7.2)) == "0:30.0"


def test_a_lamp_says_that_its_loop_waits_for_a_person_and_not_that_it_is_stale() -> None:
    snapshot = message()
    snapshot["loops"]["action_llm"] |= {"age_s": 29.0, "waits_for_person": True}
    told = bar.lamps(snapshot)
    assert "Action model waits for a person · 80 %" in words(told)
    assert "stale" not in told
