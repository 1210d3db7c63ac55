from html import unescape
from types import SimpleNamespace
from typing import Any, cast

import pytest

from console.board import Facts
from console.panels.figures import AbsencePanel, FiguresPanel
from tests.console.messages import message
from tests.console.reading import EVIL, words


def facts(picture: dict[str, Any] | None, why: str = "", fault: str = "") -> Facts:
    """What the panels look at: a mission with a picture, or with a reason why there is none."""
    hindsight = SimpleNamespace(absence=lambda mission: f"{mission}: {why}")
    return cast(
        Facts,
        SimpleNamespace(
            picture=picture,
            mission=SimpleNamespace(id="m1"),
            service=SimpleNamespace(hindsight=hindsight),
            scene_fault=fault,
        ),
    )


def test_figures_tell_trace_hits_and_the_last_solve() -> None:
    text = words(FiguresPanel.draw(facts(message()))["figures"])
    assert "Sensing hits 3 Link hits 1" in text


@pytest.mark.parametrize("why", ["it was not recorded.", EVIL])
def test_an_empty_scene_says_why_it_is_empty(why: str) -> None:
    html = AbsencePanel.draw(facts(None, why))["absence"]
    assert unescape(words(html)) == f"m1: {why}"
    assert "<script>" not in html


def test_a_scene_that_is_not_drawn_says_so() -> None:
    html = AbsencePanel.draw(facts(message(), fault="It is old."))["absence"]
    assert words(html) == "It is old."


def test_nothing_lies_over_a_picture() -> None:
    assert AbsencePanel.draw(facts(message()))["absence"] == ""
    assert FiguresPanel.draw(facts(None)) == {}
