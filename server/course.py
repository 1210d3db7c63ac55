"""How a mission went, second by second: what a timeline is drawn from. Bounded in memory.

Points are the samples of `history`. When there are too many, every two become one, so that a
mission of any length keeps its whole course, the longer it lasts the coarser.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Final

from server.encoding import EventKind, Severity

MAX_POINTS: Final = 800
"""About as many as a screen has columns for; an hour keeps every eighth second."""

MAX_MARKS: Final = 400
"""The newest are kept."""

SAMPLE_S: Final = 1.0
"""Mission time between two samples."""

LONGEST_WORDS: Final = 200

Json = Mapping[str, Any]


class MarkKind(StrEnum):
    """What a mark on the timeline is about."""

    COMMENT = "comment"
    DECISION = "decision"
    """Directives changed, or a proposal was refused by gate or person."""

    FAILURE = "failure"
    """A robot blinded, cut off or lost; an alarm."""

    HOLD = "hold"


@dataclass(frozen=True, slots=True)
class Point:
    """The figures of one stretch of mission time, which ends at `time_s`."""

    time_s: float
    trace: float | None
    """m^2, the last of the stretch."""

    sensing: int
    """Hits so far."""

    communication: int
    weights: Mapping[str, float]
    solve_ms: float | None
    """The longest of the stretch."""

    held: bool
    """Whether the team held or mission time stood still at its end."""


@dataclass(frozen=True, slots=True)
class Mark:
    """Something that happened at an instant."""

    time_s: float
    kind: MarkKind
    severity: Severity
    text: str


@dataclass(slots=True)
class Course:
    """Points and marks of one mission, in order of time."""

    points: list[Point] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)
    step_s: float = SAMPLE_S
    """Least mission time between two points."""

    version: int = 0
    """Counted up when older points or marks changed; else they are only added to."""

    _growing: Point | None = None
    """What is to become the next point once its stretch is over."""

    @property
    def until_s(self) -> float:
        """Mission time of the newest point, 0 before the first."""
        return self.points[-1].time_s if self.points else 0.0

    def add(self, sample: Json) -> None:
        """Take a sample as of `history`; one that is not newer than the last is let go."""
        point = point_of(sample)
        if self.points and point.time_s <= self.until_s:
            return
        if self._growing is not None:
            point = _joined(self._growing, point)
        if self.points and point.time_s < self.until_s + self.step_s - 1e-6:
            self._growing = point
            return
        self._growing = None
        self.points.append(point)
        if len(self.points) > MAX_POINTS:
            self._thin()

    def note(self, event: Json) -> None:
        """Take an event; most leave no mark."""
        mark = mark_of(event)
        if mark is None:
            return
        self.marks.append(mark)
        if len(self.marks) > MAX_MARKS:
            del self.marks[: MAX_MARKS // 4]
            self.version += 1

    def _thin(self) -> None:
        """Join every two points."""
        old, self.step_s = self.points, 2.0 * self.step_s
        pairs = zip(old[:-1:2], old[1::2], strict=False)
        self.points = [_joined(one, two) for one, two in pairs]
        if len(old) % 2:
            self.points.append(old[-1])
        self.version += 1


def course_of(samples: Iterable[Json], events: Iterable[Json]) -> Course:
    """Return the course that samples and events in order of time amount to."""
    course = Course()
    for sample in samples:
        course.add(sample)
    for event in events:
        course.note(event)
    course.version = 0
    return course


def sample_of(snapshot: Json) -> dict[str, Any]:
    """Return the figures of a snapshot message that `history` shows."""
    solve = snapshot["solve"] or {}
    return {
        "time_s": snapshot["time_s"],
        "state": snapshot["state"],
        "trace": snapshot["trace"],
        "attacks": snapshot["attacks"],
        "weights": snapshot["directives"]["weights"],
        "solve_ms": solve.get("solve_ms"),
        "rung": solve.get("rung"),
        "guidance": snapshot["guidance"]["level"],
        "loops": {name: loop["success_rate"] for name, loop in snapshot["loops"].items()},
    }


def point_of(sample: Json) -> Point:
    """Return a sample of `history` as a point."""
    attacks = sample["attacks"]
    return Point(
        time_s=sample["time_s"],
        trace=sample["trace"],
        sensing=attacks["sensing"],
        communication=attacks["communication"],
        weights=sample["weights"],
        solve_ms=sample["solve_ms"],
        held=sample["state"] in {"held", "paused"},
    )


def mark_of(event: Json) -> Mark | None:
    """Return the mark that an event of the stream leaves, None for most."""
    kind, severity, data = event["kind"], Severity(event["severity"]), event["data"]
    card = data.get("decision", {})
    match kind:
        case EventKind.COMMENT if data.get("status", "received") == "received":
            found = MarkKind.COMMENT
        case EventKind.DIRECTIVES:
            found = MarkKind.DECISION
        case EventKind.DECISION if card.get("refused_by") in {"gate", "person", "timeout"}:
            if card.get("effect", {}) and card["effect"].get("realised") is not None:
                return None  # told again because its effect has shown
            found = MarkKind.DECISION
        case EventKind.HOLD:
            found = MarkKind.HOLD
        case EventKind.ATTACK | EventKind.LINK | EventKind.ALARM if severity is not Severity.INFO:
            found = MarkKind.FAILURE
        case _:
            return None
    return Mark(event["time_s"], found, severity, str(event["text"])[:LONGEST_WORDS])


def _joined(one: Point, two: Point) -> Point:
    """Return two neighbours as one: the later one, with the longer solve."""
    times = [ms for ms in (one.solve_ms, two.solve_ms) if ms is not None]
    return replace(two, solve_ms=max(times, default=None))
