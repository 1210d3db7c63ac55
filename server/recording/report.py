"""The after-action report of a recording: one HTML page with its pictures inside, and CSV files."""

import csv
from base64 import b64encode
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from server.recording.figures import assignment_figure, course_figure, map_figure
from server.recording.reader import Recording
from server.recording.summary import EFFECT_S, Summary, summarise

Json = dict[str, Any]

TEMPLATE: Final = "report.html"
DECISIONS: Final = frozenset({"decision", "directives", "verdict", "proposal"})

_FIGURES: Final = (
    ("accumulated_trace", "Accumulated trace (m²)", "{:.2f}"),
    ("sensing_attacks", "Sensing attacks", "{}"),
    ("communication_attacks", "Communication attacks", "{}"),
    ("trajectory_length_m", "Trajectory length, mean over robots (m)", "{:.2f}"),
    ("min_separation_m", "Smallest separation (m)", "{:.2f}"),
    ("position_error_m", "Mean position error (m)", "{:.3f}"),
    ("steps", "Ticks", "{}"),
)
_NOTHING: Final = "–"


def write_report(recording: Recording, folder: Path) -> tuple[Path, ...]:
    """Write the report into a folder, which is made; return the files, the page first.

    Raises:
        RecordingError: The recording holds no snapshot, or is damaged.
        OSError: The folder cannot be written.
    """
    summary = summarise(recording)
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / "report.html"
    page.write_text(render(summary), encoding="utf-8")
    return (
        page,
        _table(folder / "course.csv", _course(summary)),
        _table(folder / "events.csv", _events(summary)),
        _table(folder / "comments.csv", _comments(summary)),
    )


def render(summary: Summary) -> str:
    """Return the page. Everything that people or models wrote is escaped."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    return environment.get_template(TEMPLATE).render(
        header=summary.header,
        complete=summary.complete,
        duration_s=summary.duration_s,
        figures=_figures(summary),
        loops=_loops(summary),
        course=b64encode(course_figure(summary)).decode(),
        map=b64encode(map_figure(summary)).decode(),
        assignment=b64encode(assignment_figure(summary)).decode(),
        comments=[_comment_cells(row) for row in _comments(summary)[1:]],
        effect_s=EFFECT_S,
        incidents=summary.incidents,
        decisions=[event for event in summary.events if event["kind"] in DECISIONS],
    )


def _figures(summary: Summary) -> list[tuple[str, str]]:
    result = summary.result
    if result is None:
        series = summary.series
        result = {
            "accumulated_trace": sum(trace or 0.0 for trace in series.trace),
            "sensing_attacks": series.sensing_attacks[-1],
            "communication_attacks": series.communication_attacks[-1],
            "steps": len(series.time_s),
        }
    return [
        (words, pattern.format(result[name]))
        for name, words, pattern in _FIGURES
        if result.get(name) is not None
    ]


def _loops(summary: Summary) -> list[tuple[str, ...]]:
    """Return the paper's Table II of this flight."""
    rows: list[tuple[str, ...]] = []
    for name, loop in summary.last["loops"].items():
        rows.append(
            (
                name.replace("_", " "),
                _number(loop["rate_hz"], "{:.3g}"),
                _number(loop["mean_s"], "{:.4f}"),
                _number(loop["success_rate"], "{:.1%}"),
                str(loop["calls"]),
            )
        )
    if rows or summary.result is None:
        return rows
    for name in ("task_llm", "action_llm"):
        loop = summary.result[name]
        if loop["calls"]:
            rate = loop["calls"] / max(summary.duration_s, 1e-9)
            rows.append(
                (
                    name.replace("_", " "),
                    _number(rate, "{:.3g}"),
                    _number(loop["mean_latency_s"], "{:.4f}"),
                    _number(loop["success_rate"], "{:.1%}"),
                    str(loop["calls"]),
                )
            )
    return rows


def _number(value: float | None, pattern: str) -> str:
    return _NOTHING if value is None else pattern.format(value)


def _comment_cells(row: list[Any]) -> list[str]:
    time_s, text, status, task, action, before, after = row
    return [
        f"{time_s:.1f}", text, status, task, action, _number(before, "{:.3f}"),
        _number(after, "{:.3f}"),
    ]  # fmt: skip


def _comments(summary: Summary) -> list[list[Any]]:
    rows: list[list[Any]] = [
        ["time_s", "text", "status", "task", "action", "trace_before", "trace_after"]
    ]
    for story in summary.comments:
        comment = story.comment
        answers = [_answer(comment[loop]) for loop in ("task", "action")]
        rows.append(
            [comment["time_s"], comment["text"], comment["status"], *answers,
             story.trace_before, story.trace_after]
        )  # fmt: skip
    return rows


def _answer(answer: Json | None) -> str:
    if answer is None:
        return ""
    return f"{answer['verdict']}: {answer['reason']}" if answer["reason"] else answer["verdict"]


def _course(summary: Summary) -> list[list[Any]]:
    series = summary.series
    names = list(series.weights)
    rows: list[list[Any]] = [
        ["time_s", "trace", "sensing_attacks", "communication_attacks", "failing_robots",
         "solve_ms", "rung", *(f"weight_{name}" for name in names)]
    ]  # fmt: skip
    columns = (
        series.time_s, series.trace, series.sensing_attacks, series.communication_attacks,
        series.failed, series.solve_ms, series.rung, *(series.weights[name] for name in names),
    )  # fmt: skip
    rows.extend(map(list, zip(*columns, strict=True)))
    return rows


def _events(summary: Summary) -> list[list[Any]]:
    rows: list[list[Any]] = [["time_s", "seq", "kind", "severity", "text"]]
    keys = ("time_s", "seq", "kind", "severity", "text")
    rows.extend([event[key] for key in keys] for event in summary.events)
    return rows


def _table(path: Path, rows: Iterable[list[Any]]) -> Path:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([_safe(cell) for cell in row] for row in rows)
    return path


def _safe(cell: Any) -> Any:
    """Return a cell that no spreadsheet takes for a formula: texts are other people's words."""
    if isinstance(cell, str) and cell[:1] in {"=", "+", "-", "@", "\t", "\r"}:
        return f"'{cell}"
    return cell
