import re
from typing import Any

from console.panels import supervise
from tests.console.reading import EVIL, words


def comment(**changes: Any) -> dict[str, Any]:
    return {
        "id": "c1",
        "text": "Focus on 122.",
        "author": "operator",
        "time_s": 63.2,
        "status": "applied",
        "task": {"verdict": "applied", "reason": "Robot 21 takes it.", "proposal": "t1"},
        "action": {"verdict": "noted", "reason": "", "proposal": ""},
    } | changes


def test_receipts_say_what_changed_and_why() -> None:
    html = supervise.receipts([comment()], {"t1": "d7"})
    assert words(html) == (
        "Applied operator · 1:03.2 Focus on 122. Task model applied: Robot 21 takes it. d7"
        " Action model noted"
    )
    assert 'class="receipt applied"' in html
    assert re.findall('data-reveal="([^"]+)"', html) == ["d7"]


def test_the_newest_comment_comes_first() -> None:
    html = supervise.receipts([comment(text="first"), comment(text="second")], {})
    assert html.index("second") < html.index("first")


def test_what_people_and_models_write_is_never_run() -> None:
    answer = {"verdict": "declined", "reason": EVIL, "proposal": "t1"}
    html = supervise.receipts([comment(text=EVIL, author=EVIL, id=EVIL, task=answer)], {"t1": EVIL})
    assert "<script>" not in html
    assert html.count("&lt;script&gt;") == 6
