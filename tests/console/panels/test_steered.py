"""What panels keep of a person's own, while the mission goes on: tried weights, held sliders."""

from types import SimpleNamespace
from typing import Any, cast

from console.panels.weights import Tried, changed_since
from console.panels.zones import _hold, _Row


def test_what_was_changed_while_weights_were_put_in_force_is_still_tried() -> None:
    put: Tried = {"tracking": 40.0, "control": 0.1}
    now: Tried = {"tracking": 40.0, "control": 0.2, "sensing": None}
    assert changed_since(now, put) == {"control": 0.2, "sensing": None}
    assert changed_since(put, put) == {}


def row(**known: Any) -> _Row:
    parts = SimpleNamespace(set_text=lambda words: None)
    return _Row(*(cast(Any, parts),) * 3, **known)


def test_a_slider_is_let_be_while_it_is_moved() -> None:
    moved = row()
    _hold(moved, 2.3)
    assert moved.held


def test_late_news_of_where_a_slider_was_left_do_not_hold_it_again() -> None:
    left = row(left_at=2.3)
    held = []
    for place in (2.3, 2.4, 2.3):  # late news; then it is moved again, and back
        _hold(left, place)
        held.append(left.held)
    assert held == [False, True, True]
