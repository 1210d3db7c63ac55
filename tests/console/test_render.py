import pytest

from console import render
from tests.console.reading import EVIL


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [(None, "–:––"), (0.0, "0:00.0"), (9.96, "0:10.0"), (63.2, "1:03.2"), (3600.0, "60:00.0")],
)
def test_the_clock(seconds: float | None, shown: str) -> None:
    assert render.clock(seconds) == shown


def test_text_is_shown_and_never_run() -> None:
    assert render.escape(EVIL) == "&lt;script&gt;alert(&quot;x&quot;)&lt;/script&gt;"


def test_words_cannot_be_turned_around() -> None:
    assert render.escape("\u202e0 enord \u2066x") == "0 enord x"
