from typing import Any

import pytest

from server.course import MAX_MARKS, MAX_POINTS, Course, MarkKind, course_of, mark_of, sample_of
from server.encoding import EventKind, Severity, event_message
from tests.console.messages import message


def sample(time_s: float, solve_ms: float = 1.0, **changes: Any) -> dict[str, Any]:
    return {
        "time_s": time_s,
        "state": "running",
        "trace": 10.0 - 0.001 * time_s,
        "attacks": {"sensing": int(time_s // 60), "communication": 0},
        "weights": {"tracking": 10.0},
        "solve_ms": solve_ms,
    } | changes


def event(kind: EventKind, severity: Severity, **data: Any) -> dict[str, Any]:
    return event_message("m1", 1, 12.0, kind, severity, "Something happened.", data)


def test_a_short_mission_keeps_every_second() -> None:
    course = course_of((sample(float(t)) for t in range(100)), ())
    assert [point.time_s for point in course.points] == [float(t) for t in range(100)]
    assert course.version == 0
    assert course.until_s == 99.0


@pytest.mark.parametrize("hours", [1, 10])
def test_a_long_mission_keeps_its_whole_course_in_bounded_memory(hours: int) -> None:
    """The longest solve survives every joining, and points lie evenly."""
    course = Course()
    for t in range(hours * 3600):
        course.add(sample(float(t), solve_ms=77.0 if t == 1234 else 1.0))
        assert len(course.points) <= MAX_POINTS
    assert course.points[0].time_s <= course.step_s
    assert course.until_s >= hours * 3600 - 1 - course.step_s
    assert max(point.solve_ms or 0.0 for point in course.points) == 77.0
    gaps = {b.time_s - a.time_s for a, b in zip(course.points, course.points[1:], strict=False)}
    assert max(gaps) <= 2.0 * course.step_s
    assert len(course.points) > MAX_POINTS // 3


def test_between_two_versions_points_are_only_added() -> None:
    course = Course()
    seen: list[Any] = []
    version = course.version
    for t in range(5 * MAX_POINTS):
        course.add(sample(float(t)))
        if course.version == version:
            assert course.points[: len(seen)] == seen
        seen, version = list(course.points), course.version
    assert version > 0


def test_what_is_not_newer_is_let_go() -> None:
    course = course_of([sample(5.0), sample(5.0, trace=99.0), sample(3.0)], ())
    assert [point.trace for point in course.points] == [10.0 - 0.005]


def test_a_snapshot_gives_a_sample_and_a_point() -> None:
    course = course_of([sample_of(message(30.0))], ())
    (point,) = course.points
    assert (point.time_s, point.sensing, point.communication) == (30.0, 3, 1)
    assert point.weights["tracking"] == 10.0
    assert point.solve_ms == pytest.approx(2.1)
    assert not point.held
    (held,) = course_of([sample(1.0, state="held")], ()).points
    assert held.held


@pytest.mark.parametrize(
    ("told", "kind"),
    [
        (event(EventKind.COMMENT, Severity.INFO, status="received"), MarkKind.COMMENT),
        (event(EventKind.COMMENT, Severity.INFO, status="applied"), None),
        (event(EventKind.DIRECTIVES, Severity.INFO, what="weights"), MarkKind.DECISION),
        (event(EventKind.DECISION, Severity.INFO, decision={"refused_by": None}), None),
        (
            event(EventKind.DECISION, Severity.WARNING, decision={"refused_by": "gate"}),
            MarkKind.DECISION,
        ),
        (
            event(
                EventKind.DECISION,
                Severity.INFO,
                decision={"refused_by": "gate", "effect": {"realised": {}}},
            ),
            None,
        ),
        (event(EventKind.ATTACK, Severity.WARNING, robot=3), MarkKind.FAILURE),
        (event(EventKind.LINK, Severity.ALARM, link="lost"), MarkKind.FAILURE),
        (event(EventKind.LINK, Severity.INFO, link="connected"), None),
        (event(EventKind.HOLD, Severity.WARNING), MarkKind.HOLD),
        (event(EventKind.LOOP, Severity.INFO), None),
    ],
)
def test_what_leaves_a_mark(told: dict[str, Any], kind: MarkKind | None) -> None:
    mark = mark_of(told)
    assert (None if mark is None else mark.kind) is kind


def test_marks_are_bounded_and_the_newest_stay() -> None:
    course = Course()
    for number in range(3 * MAX_MARKS):
        said = event(EventKind.HOLD, Severity.INFO) | {"text": f"hold {number}"}
        course.note(said)
        assert len(course.marks) <= MAX_MARKS
    assert course.marks[-1].text == f"hold {3 * MAX_MARKS - 1}"
    assert course.version > 0
