from console.panels import events
from tests.console.reading import EVIL, words


def event(text: str, severity: str = "info") -> dict[str, object]:
    return {"severity": severity, "time_s": 63.2, "text": text}


def test_the_newest_event_comes_first() -> None:
    assert words(events.events([event("first"), event("second", "alarm")])) == (
        "1:03.2 second 1:03.2 first"
    )


def test_what_is_told_is_never_run() -> None:
    html = events.events([event(EVIL, EVIL)])
    assert "<script>" not in html
    assert html.count("&lt;script&gt;") == 2
