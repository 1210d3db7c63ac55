import re
from typing import Any

from console.panels import team as panel
from tests.console.messages import message
from tests.console.reading import words


def test_the_team_table_tells_states_targets_and_silence() -> None:
    rows = re.findall(r"<tr.*?>(.*?)</tr>", panel.team(message(), {21: "d7"}))[1:]
    assert [words(row).split(" ")[:2] for row in rows] == [
        ["D21", "ok"],
        ["D26", "blind"],
        ["D31", "jammed"],
        ["D34", "ok"],
    ]
    assert "T121 T125 d7" in words(rows[0])
    assert 'data-reveal="d7"' in rows[0]
    assert words(rows[3]).endswith("never")


def test_of_a_silent_team_the_table_tells_what_was() -> None:
    rows = re.findall(r"<tr.*?>(.*?)</tr>", panel.team(message(), {}, 5.0))[1:]
    states = [words(row).partition(" T")[0] for row in rows]
    assert states == ["D21 was ok", "D26 was blind", "D31 was jammed", "D34 was ok"]
    assert words(rows[0]).endswith("5.0 s")
    assert 'class="state"' in rows[1], "no colour for what nobody knows"


def test_a_robot_names_the_newest_decision_in_force_about_it() -> None:
    rows = [{"robot": 21, "gains": [122], "loses": []}]
    cards: list[dict[str, Any]] = [
        {"id": "d9", "status": "refused", "changes": {"assignment": rows}},
        {"id": "d8", "status": "adopted", "changes": {"assignment": rows}},
        {"id": "d7", "status": "adopted", "changes": {"assignment": rows}},
        {"id": "d6", "status": "adopted"},  # an older recording's
        {"id": "d5"},
    ]
    assert panel.last_decisions(cards) == {21: "d8"}
