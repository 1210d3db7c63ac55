import re
from typing import Any

import pytest

from console import assignment
from console.ledger import Ledger
from solver.directives import Pairing, Pin
from tests.console.messages import message
from tests.console.test_ledger import card
from tests.server.scripted import directives

EVIL = '"><script>alert("x")</script>'


def cell(html: str, robot_id: int, target_id: int) -> tuple[str, str]:
    """Return the classes and the title of a cell."""
    found = re.search(
        rf'<(?:td|span) class="([^"]*)"><button type="button"'
        rf' data-tap="pair:{robot_id}:{target_id}" title="([^"]*)"',
        html,
    )
    assert found is not None
    return found[1], found[2]


def shown(*pins: Pin, ledger: Ledger | None = None) -> str:
    said = message(directives=directives(pins=pins))
    return assignment.matrix(said, Ledger() if ledger is None else ledger)


def test_a_cell_says_whether_it_is_assigned_and_what_pressing_it_does() -> None:
    html = shown()
    assert cell(html, 21, 121) == (
        "cell on well",
        "robot 21, target 121: assigned; press to pin",
    )
    assert cell(html, 21, 122)[1] == "robot 21, target 122: not assigned; press to pin"
    assert "blind" in cell(html, 26, 122)[0]
    assert html.count('data-tap="pair:') == 4 * 6


def test_pins_have_rings_forbids_a_cross_and_both_say_who_and_until_when() -> None:
    ledger = Ledger()
    ledger.note_card(card(1, 63.0, pins_set=[{"id": "keep"}]))
    html = shown(
        Pin("keep", Pairing(21, 125), None),
        Pin("never", Pairing(34, 121), 120.0, None, forbids=True),
        Pin("p1", Pairing(31, 123), 90.0, "c1"),
        ledger=ledger,
    )
    tone, title = cell(html, 21, 125)
    assert "pin" in tone.split()
    assert "assigned, pinned by ada at 1:03.0 for good; press to keep apart" in title
    tone, title = cell(html, 34, 121)
    assert "forbid" in tone.split()
    assert "not assigned, kept apart by an operator until 2:00.0; press to set free" in title
    assert "pinned by comment c1 until 1:30.0" in cell(html, 31, 123)[1]


def test_a_persons_word_counts_before_a_comments() -> None:
    html = shown(
        Pin("mine", Pairing(21, 125), None, None, forbids=True),
        Pin("p1", Pairing(21, 125), None, "c1"),
    )
    assert "forbid" in cell(html, 21, 125)[0].split()


def test_a_large_team_is_a_list_that_can_be_pressed_too() -> None:
    said = message(
        directives=directives(pins=(Pin("n", Pairing(21, 123), None, None, forbids=True),))
    )
    extra = said["targets"][0]
    said["targets"] += [extra | {"id": number} for number in range(200, 220)]
    html = assignment.matrix(said, Ledger())
    assert "list" in html
    assert "on" in cell(html, 21, 121)[0].split()
    assert "forbid" in cell(html, 21, 123)[0].split()
    assert 'data-tap="pair:21:200"' not in html


def test_capacities_are_shown_with_whose_they_are() -> None:
    ledger = Ledger()
    ledger.note_card(card(1, 30.0, capacities={"21": [2, 3]}))
    html = assignment.matrix(message(), ledger)
    assert "robot 21: at most 2 targets, by ada at 0:30.0; press to change" in html
    assert "robot 26: at most 2 targets, by the scenario; press to change" in html


def test_names_from_outside_are_never_run() -> None:
    ledger = Ledger()
    ledger.note_card(
        card(1, pins_set=[{"id": "keep"}], capacities={"21": [2, 3]}) | {"author": EVIL}
    )
    html = shown(Pin("keep", Pairing(21, 125), None), ledger=ledger)
    assert "<script" not in html
    assert EVIL not in html


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("pair:21:122", ("pair", (21, 122))),
        ("capacity:21", ("capacity", (21,))),
        ("pair:21", None),
        ("pair:21:122:3", None),
        ("pair:-1:122", None),
        ("pair:٣:122", None),
        ("capacity:99999999999", None),
        ("", None),
    ],
)
def test_what_a_browser_says_was_tapped_is_not_believed(value: str, expected: Any) -> None:
    assert assignment.tapped(value) == expected
