import re
from typing import Any

import pytest

from console import render
from solver.directives import Pairing, Pin
from tests.console.messages import message
from tests.server.scripted import directives

EVIL = '<script>alert("x")</script>'


def words(html: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html)).strip()


def comment(**changes: Any) -> dict[str, Any]:
    return {
        "id": "c1",
        "text": "Focus on 122.",
        "author": "operator",
        "time_s": 63.2,
        "status": "applied",
        "task": {"verdict": "applied", "reason": "Robot 21 takes it."},
        "action": {"verdict": "noted", "reason": ""},
    } | changes


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [(None, "–:––"), (0.0, "0:00.0"), (9.96, "0:10.0"), (63.2, "1:03.2"), (3600.0, "60:00.0")],
)
def test_the_clock(seconds: float | None, shown: str) -> None:
    assert render.clock(seconds) == shown


def test_receipts_say_what_changed_and_why() -> None:
    html = render.receipts([comment()])
    assert words(html) == (
        "Applied operator · 1:03.2 Focus on 122. Task model applied: Robot 21 takes it."
        " Action model noted"
    )
    assert 'class="receipt applied"' in html


def test_the_newest_comment_comes_first() -> None:
    html = render.receipts([comment(text="first"), comment(text="second")])
    assert html.index("second") < html.index("first")


def test_what_people_and_models_write_is_never_run() -> None:
    answer = {"verdict": "declined", "reason": EVIL}
    said = comment(text=EVIL, author=EVIL, id=EVIL, task=answer)
    event = {"severity": "info", "time_s": 1.0, "text": EVIL}
    for html in (render.receipts([said]), render.events([event])):
        assert "<script>" not in html
        assert "&lt;script&gt;" in html


def test_words_cannot_be_turned_around() -> None:
    html = render.receipts([comment(text="\u202e0 enord \u2066x")])
    assert "0 enord x" in html
    assert not set(html) & {"\u202e", "\u2066"}


def test_the_team_table_tells_states_targets_and_silence() -> None:
    rows = re.findall(r"<tr>(.*?)</tr>", render.team(message()))[1:]
    assert [words(row).split(" ")[:2] for row in rows] == [
        ["D21", "ok"],
        ["D26", "blind"],
        ["D31", "jammed"],
        ["D34", "ok"],
    ]
    assert "T121 T125" in words(rows[0])
    assert words(rows[3]).endswith("never")


def test_the_matrix_shows_pairs_and_pins() -> None:
    pin = Pin("p1", Pairing(21, 125), None, "c1")
    html = render.matrix(message(directives=directives(pins=(pin,))))
    assert html.count('class="cell') == 4 * 6
    assert html.count("cell on") == 6
    assert 'title="robot 21, target 125: assigned, pinned by comment c1"' in html
    assert html.count(" pin ") == 1


def test_a_wide_matrix_becomes_a_list() -> None:
    said = message()
    said["targets"] = [said["targets"][0] | {"id": number} for number in range(17)]
    assert "cell" not in render.matrix(said)
    assert "T121 T125" in words(render.matrix(said))


def test_weights_stand_between_their_bounds_on_a_logarithmic_scale() -> None:
    html = render.weights(message())
    assert re.findall(r"left:([\d.]+)%", html) == ["50.0"] * 4
    assert words(html).startswith("Tracking 10 1 100 Effort 0.05 0.005 0.5")


@pytest.mark.parametrize(
    ("name", "changes", "level"),
    [
        ("task_llm", {"calls": 0}, "idle"),
        ("task_llm", {"age_s": 25.0}, "ok"),
        ("task_llm", {"age_s": 61.0}, "alarm"),
        ("task_llm", {"age_s": None}, "alarm"),
        ("task_llm", {"success_rate": 0.5}, "warn"),
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
    assert render.loop_level(name, loop | changes) == level


def test_lamps_name_all_three_loops() -> None:
    assert words(render.lamps(message())) == (
        "Optimizer 10.0 Hz · 100 % Task model 10 s ago · 100 % Action model 0 s ago · 80 %"
    )


def test_suggestions_ask_a_fit_robot_for_the_least_known_target() -> None:
    said = message()
    traces = {t["id"]: t["covariance"][0][0] + t["covariance"][1][1] for t in said["targets"]}
    worst = max(traces, key=lambda target: traces[target])
    first = render.suggestions(said)[0]
    drone = int(re.findall(r"Drone (\d+)", first)[0])
    assert f"target {worst}." in first
    assert drone in (21, 34)
    assert worst not in said["directives"]["assignment"][str(drone)]


def test_nothing_is_suggested_before_there_is_a_team() -> None:
    assert render.suggestions(None) == []
