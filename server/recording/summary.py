"""What a recording amounts to: the mission's figures over time, its comments, its incidents.

Everything is read from what the stream told people, so a report says what they could see.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final

from server.recording.errors import RecordingError
from server.recording.header import header_summary
from server.recording.reader import Recording

Json = dict[str, Any]

EFFECT_S: Final = 20.0
"""The trace is averaged over this long before and after a comment."""

INCIDENTS: Final = frozenset({"warning", "alarm"})


@dataclass(slots=True)
class Series:
    """One row per snapshot."""

    time_s: list[float] = field(default_factory=list)
    trace: list[float | None] = field(default_factory=list)
    solve_ms: list[float | None] = field(default_factory=list)
    rung: list[str] = field(default_factory=list)
    sensing_attacks: list[int] = field(default_factory=list)
    communication_attacks: list[int] = field(default_factory=list)
    weights: dict[str, list[float]] = field(default_factory=dict)
    assignments: list[dict[str, list[int]]] = field(default_factory=list)
    failed: list[int] = field(default_factory=list)
    """Robots blinded, cut off or lost."""

    robots: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    targets: dict[int, list[tuple[float, float]]] = field(default_factory=dict)

    def add(self, snapshot: Json) -> None:
        """Append one snapshot."""
        solve = snapshot["solve"] or {}
        self.time_s.append(snapshot["time_s"])
        self.trace.append(snapshot["trace"])
        self.solve_ms.append(solve.get("solve_ms"))
        self.rung.append(solve.get("rung", ""))
        self.sensing_attacks.append(snapshot["attacks"]["sensing"])
        self.communication_attacks.append(snapshot["attacks"]["communication"])
        for name, value in snapshot["directives"]["weights"].items():
            self.weights.setdefault(name, []).append(value)
        self.assignments.append(snapshot["directives"]["assignment"])
        self.failed.append(
            sum(r["sensing_failed"] or r["link"] != "connected" for r in snapshot["robots"])
        )
        for places, ones in (
            (self.robots, snapshot["robots"]),
            (self.targets, snapshot["targets"]),
        ):
            for one in ones:
                if one["position"] is not None:
                    x, y = one["position"][:2]
                    places.setdefault(one["id"], []).append((x, y))


@dataclass(frozen=True, slots=True)
class CommentStory:
    """One comment: what became of it, and how the trace stood before and after."""

    comment: Json
    trace_before: float | None
    trace_after: float | None


@dataclass(frozen=True, slots=True)
class Summary:
    """A whole recording, ready to be shown."""

    header: Json
    complete: bool
    duration_s: float
    series: Series
    last: Json
    """The newest snapshot."""

    comments: tuple[CommentStory, ...]
    events: tuple[Json, ...]
    incidents: tuple[Json, ...]
    result: Json | None
    """The mission's figures, None where it was cut off before its end."""


def summarise(recording: Recording) -> Summary:
    """Read a recording through. Raises RecordingError when it holds no snapshot."""
    series, last = Series(), None
    comments: dict[str, Json] = {}
    for snapshot in recording.snapshots():
        series.add(snapshot)
        comments |= {comment["id"]: comment for comment in snapshot["comments"]}
        last = snapshot
    if last is None:
        raise RecordingError(f"{recording.path}: it holds no snapshot to report on")
    events = tuple(recording.events())
    ended = [event for event in events if event["kind"] == "ended"]
    return Summary(
        header=header_summary(recording.header),
        complete=recording.complete,
        duration_s=recording.duration_s,
        series=series,
        last=last,
        comments=tuple(_story(comment, series) for comment in comments.values()),
        events=events,
        incidents=tuple(event for event in events if event["severity"] in INCIDENTS),
        result=ended[-1]["data"].get("result") if ended else None,
    )


def _story(comment: Json, series: Series) -> CommentStory:
    said_s = comment["time_s"]
    rows = list(zip(series.time_s, series.trace, strict=True))
    before = (trace for t, trace in rows if said_s - EFFECT_S <= t < said_s)
    after = (trace for t, trace in rows if said_s <= t < said_s + EFFECT_S)
    return CommentStory(comment, _mean(before), _mean(after))


def _mean(values: Iterable[float | None]) -> float | None:
    finite = [value for value in values if value is not None]
    return sum(finite) / len(finite) if finite else None
