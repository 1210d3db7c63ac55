"""The timeline as SVG: whole for a browser that comes, what is new for those that are there.

Lines are drawn in the units of what they show (mission seconds to the right, values up); a
`viewBox` gives the scale. So a new second adds a point to each line and changes a few numbers, and
nothing that was sent is sent again.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from console.render import clock, escape
from server.course import Course, Mark, MarkKind, Point
from server.encoding import Severity

Json = dict[str, Any]

LEAST_DECADES: Final = 1.0
"""Of a logarithmic lane: small changes shall not look large."""

MARK_ROWS: Final = {
    MarkKind.COMMENT: 0,
    MarkKind.HOLD: 0,
    MarkKind.DECISION: 1,
    MarkKind.FAILURE: 2,
}
MARK_TITLES: Final = ("Comments, holds", "Decisions", "Failures")
WEIGHTS: Final = ("tracking", "control", "sensing", "communication")


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a lane."""

    name: str
    value: Callable[[Point], float | None]
    stepped: bool = False


@dataclass(frozen=True, slots=True)
class Lane:
    """Lines over one scale."""

    name: str
    title: str
    lines: tuple[Line, ...]
    words: Callable[[Point], str]
    """The newest figures."""

    logarithmic: bool = False


def _log(value: float | None) -> float | None:
    return None if value is None or value <= 0.0 else math.log10(value)


def _weight(name: str) -> Callable[[Point], float | None]:
    return lambda point: _log(point.weights.get(name))


LANES: Final = (
    Lane(
        "trace",
        "Trace",
        (Line("trace", lambda p: _log(p.trace)),),
        lambda p: "–" if p.trace is None else f"{p.trace:.2f} m²",
        logarithmic=True,
    ),
    Lane(
        "attacks",
        "Hits",
        (
            Line("sensing", lambda p: float(p.sensing), stepped=True),
            Line("communication", lambda p: float(p.communication), stepped=True),
        ),
        lambda p: (
            f'<span class="sensing">{p.sensing} sensing</span>'
            f' <span class="communication">{p.communication} link</span>'
        ),
    ),
    Lane(
        "weights",
        "Weights",
        tuple(Line(name, _weight(name), stepped=True) for name in WEIGHTS),
        lambda p: " ".join(
            f'<span class="{name}" title="{name}">{p.weights[name]:.3g}</span>'
            for name in WEIGHTS
            if name in p.weights
        ),
        logarithmic=True,
    ),
    Lane(
        "solve",
        "Solve",
        (Line("solve", lambda p: p.solve_ms),),
        lambda p: "–" if p.solve_ms is None else f"{p.solve_ms:.1f} ms",
    ),
)


@dataclass(frozen=True, slots=True)
class Cursor:
    """How much of a course somebody has been sent."""

    mission: str
    version: int
    points: int
    marks: int


def cursor_of(mission: str, course: Course) -> Cursor:
    """Return where somebody stands who has been sent all of a course."""
    return Cursor(mission, course.version, len(course.points), len(course.marks))


def whole(course: Course) -> str:
    """Return the lanes with everything there is."""
    lanes = "".join(_lane(lane, course) for lane in LANES)
    rows = "".join(f"<span>{title}</span>" for title in MARK_TITLES)
    marks = "".join(mark_svg(mark) for mark in course.marks)
    return (
        f'<div class="lane marks"><div class="head">{rows}</div>'
        f'<svg preserveAspectRatio="none" aria-hidden="true"><g>{marks}</g></svg></div>{lanes}'
    )


def added(course: Course, since: Cursor) -> Json:
    """Return what has come since a cursor of the same version: points, marks, scales."""
    new = course.points[since.points :]
    before = course.points[since.points - 1] if since.points else None
    return {
        "lines": {
            f"{lane.name}-{line.name}": _points(line, new, before)
            for lane in LANES
            for line in lane.lines
        },
        "marks": "".join(mark_svg(mark) for mark in course.marks[since.marks :]),
        "scales": scales(course),
        "words": words(course),
    }


def scales(course: Course) -> dict[str, list[float]]:
    """Return per lane the lowest and the highest value drawn, and the label of the highest."""
    return {lane.name: list(_scale(lane, course)) for lane in LANES}


def words(course: Course) -> dict[str, str]:
    """Return per lane the newest figures, as HTML."""
    last = course.points[-1] if course.points else None
    return {lane.name: "–" if last is None else lane.words(last) for lane in LANES}


def mark_svg(mark: Mark) -> str:
    """Return a mark as a stroke in its row, with its words as a tooltip."""
    row = MARK_ROWS[mark.kind]
    tone = {Severity.INFO: "", Severity.WARNING: " warning", Severity.ALARM: " alarm"}
    said = escape(f"{clock(mark.time_s)} {mark.text}")
    x = _number(mark.time_s)
    return (
        f'<path class="mark {mark.kind.value}{tone[mark.severity]}"'
        f' d="M{x} {row}.14V{row}.86"><title>{said}</title></path>'
    )


def _lane(lane: Lane, course: Course) -> str:
    low, high = _scale(lane, course)
    last = course.points[-1] if course.points else None
    lines = "".join(
        f'<polyline class="{line.name}" data-line="{lane.name}-{line.name}"'
        f' points="{_points(line, course.points, None)}"/>'
        for line in lane.lines
    )
    return (
        f'<div class="lane {lane.name}" data-lane="{lane.name}"'
        f' data-low="{low:g}" data-high="{high:g}">'
        f'<div class="head"><span>{lane.title}</span>'
        f"<b>{'–' if last is None else lane.words(last)}</b></div>"
        f'<svg preserveAspectRatio="none" aria-hidden="true">{lines}</svg></div>'
    )


def _points(line: Line, points: list[Point], before: Point | None) -> str:
    """Return a line's points; y grows downwards in SVG, so that values are negated."""
    found = []
    last = None if before is None else line.value(before)
    for point in points:
        value = line.value(point)
        if value is None:
            continue
        x = _number(point.time_s)
        if line.stepped and last is not None and value != last:
            found.append(f"{x},{_number(-last)}")
        found.append(f"{x},{_number(-value)}")
        last = value
    return " ".join(found)


def _scale(lane: Lane, course: Course) -> tuple[float, float]:
    values = [
        value
        for point in course.points
        for line in lane.lines
        if (value := line.value(point)) is not None and math.isfinite(value)
    ]
    if not values:
        return 0.0, 1.0
    if lane.logarithmic:
        middle = 0.5 * (min(values) + max(values))
        half = max(LEAST_DECADES / 2.0, 0.5 * (max(values) - min(values)) + 0.1)
        return middle - half, middle + half
    return 0.0, _round_up(max(values))


def _round_up(value: float) -> float:
    """Return the next of 1, 1.5, 2, 3, 5, 7 times a power of ten at or above a value."""
    if value <= 0.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(m * power for m in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0) if m * power >= value)


def _number(value: float) -> str:
    return f"{value:.4g}" if abs(value) < 1000.0 else f"{value:.1f}"
