import re
from typing import Any

import pytest

from console.course import LANES, Cursor, added, cursor_of, whole
from server.course import Course, course_of
from server.encoding import EventKind, Severity, event_message
from tests.server.test_course import sample

EVIL = '</title><script>alert("x")</script>'


def flown(seconds: int) -> Course:
    return course_of((sample(float(t), solve_ms=1.0 + t) for t in range(seconds)), ())


def hit(course: Course, words: str, time_s: float = 3.0) -> None:
    course.note(event_message("m1", 1, time_s, EventKind.ATTACK, Severity.WARNING, words, {}))


def lines(html: str) -> dict[str, str]:
    return dict(re.findall(r'data-line="([^"]+)" points="([^"]*)"', html))


def test_lanes_are_drawn_in_their_own_units_upside_down() -> None:
    drawn = lines(whole(flown(3)))
    assert drawn["solve-solve"] == "0,-1 1,-2 2,-3"
    assert drawn["weights-tracking"] == "0,-1 1,-1 2,-1", "logarithmic: ten is one"
    assert set(drawn) == {f"{lane.name}-{line.name}" for lane in LANES for line in lane.lines}


def test_counts_go_up_in_steps() -> None:
    course = course_of([sample(59.0), sample(61.0)], ())
    assert lines(whole(course))["attacks-sensing"] == "59,-0 61,-0 61,-1"


def test_what_is_added_to_a_part_makes_the_whole() -> None:
    """A browser that came early shows what one that comes now is sent at once."""
    course = flown(100)
    hit(course, "first")
    early, since = whole(course), cursor_of("m1", course)
    for t in range(100, 140):
        course.add(sample(float(t), solve_ms=1.0 + t))
    hit(course, "second")
    news = added(course, since)
    late = lines(whole(course))
    for name, points in lines(early).items():
        assert f"{points} {news['lines'][name]}".strip() == late[name]
    assert "second" in news["marks"]
    assert "first" not in news["marks"]
    assert news["words"]["solve"] == "140.0 ms"
    low, high = news["scales"]["solve"]
    assert low == 0.0
    assert high >= 140.0


def test_a_second_costs_little_however_long_the_mission_is() -> None:
    course = flown(1000)
    since = cursor_of("m1", course)
    course.add(sample(1000.0))
    assert len(str(added(course, since))) < 1500
    assert len(whole(course)) < 150_000


def test_nothing_is_known_of_a_mission_that_has_not_flown() -> None:
    html = whole(Course())
    assert html.count("<polyline") == sum(len(lane.lines) for lane in LANES)
    assert added(Course(), Cursor("m1", 0, 0, 0))["marks"] == ""


def test_values_that_are_not_there_leave_a_gap() -> None:
    course = course_of([sample(0.0), sample(1.0, trace=None), sample(2.0)], ())
    assert lines(whole(course))["trace-trace"].startswith("0,-1 2,")


def test_what_events_say_is_never_run() -> None:
    course = flown(2)
    hit(course, EVIL)
    for html in (whole(course), added(course, Cursor("m1", 0, 2, 0))["marks"]):
        assert "<script>" not in html
        assert "&lt;script&gt;" in html


@pytest.mark.parametrize("trace", [0.01, 1.0, 5000.0])
def test_scales_hold_every_value(trace: float) -> None:
    course = course_of([sample(0.0, trace=trace), sample(1.0, trace=3.0 * trace)], ())
    news: dict[str, Any] = added(course, Cursor("m1", 0, 0, 0))
    low, high = news["scales"]["trace"]
    for point in news["lines"]["trace-trace"].split():
        assert low < -float(point.split(",")[1]) < high
