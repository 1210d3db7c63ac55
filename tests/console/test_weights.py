import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from console import weights
from console.ledger import Ledger
from tests.console.messages import message
from tests.console.test_ledger import card

BOUNDS = (1.0, 100.0)


def curve(html: str) -> list[tuple[float, float]]:
    points = re.search(r'points="([^"]*)"', html)
    assert points is not None
    return [(float(x), float(y)) for x, y in (p.split(",") for p in points[1].split())]


def test_the_scale_is_logarithmic() -> None:
    assert weights.position(10.0, BOUNDS) == pytest.approx(0.5 * weights.STEPS)
    assert weights.value_at(0.5 * weights.STEPS, BOUNDS) == 10.0
    assert weights.value_at(0, BOUNDS) == 1.0
    assert weights.value_at(weights.STEPS, BOUNDS) == 100.0


@given(st.floats(-1e4, 1e4), st.floats(1e-6, 1e3), st.floats(1.001, 1e6))
def test_no_slider_leaves_the_bounds(where: float, lower: float, ratio: float) -> None:
    bounds = (lower, lower * ratio)
    assert bounds[0] <= weights.value_at(where, bounds) <= bounds[1]


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (10.0, ""),
        (1.0, ""),
        (None, "Tracking: a number from 1 to 100."),
        (math.inf, "Tracking: a number from 1 to 100."),
        (0.5, "Tracking: 0.5 is not from 1 to 100."),
        (101.0, "Tracking: 101 is not from 1 to 100."),
    ],
)
def test_what_is_wrong_names_the_weight_and_its_range(value: float | None, words: str) -> None:
    assert weights.problem("tracking", value, BOUNDS) == words


def test_the_history_steps_where_the_weight_was_changed() -> None:
    ledger = Ledger()
    ledger.note_card(card(1, 600.0 - 150.0, weights={"tracking": [1.0, 10.0]}))
    said = message(600.0)
    html = weights.history(said, ledger, "tracking")
    xs, ys = zip(*curve(html), strict=True)
    assert xs == (0.0, 60.0, 60.0, 120.0)
    assert ys[0] == ys[1] > ys[2] == ys[3]
    assert "ada, 7:30.0" in html


def test_what_is_older_than_the_curve_still_tells_who() -> None:
    ledger = Ledger()
    ledger.note_card(card(1, 1.0, weights={"tracking": [1.0, 10.0]}))
    html = weights.history(message(600.0), ledger, "tracking")
    assert [x for x, _ in curve(html)] == [0.0, 120.0]
    assert "ada, 0:01.0" in html
    assert "as in the scenario" in weights.history(message(600.0), ledger, "control")


def test_a_name_from_outside_is_never_run() -> None:
    ledger = Ledger()
    ledger.note_card(card(1, weights={"tracking": [1.0, 10.0]}) | {"author": '"><script>'})
    assert "<script" not in weights.history(message(600.0), ledger, "tracking")
