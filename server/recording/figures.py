"""The figures of an after-action report, as PNG pictures."""

from io import BytesIO
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from server.recording.summary import Series, Summary

DPI: Final = 110
ZONE_COLOURS: Final = {"sensing": "#c62828", "communication": "#1e5bd6"}
_TRACE: Final = "#20262e"
_FAILED: Final = "#e08a00"


def map_figure(summary: Summary) -> bytes:
    """Return the field from above: paths, estimates, the zones the team came to know."""
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    axes = figure.subplots()
    for zone in summary.last["zones"]:
        _draw_zone(axes, zone)
    for robot_id, path in summary.series.robots.items():
        xy = np.asarray(path)
        (line,) = axes.plot(xy[:, 0], xy[:, 1], linewidth=1.2, label=f"robot {robot_id}")
        axes.plot(*xy[-1], marker="o", color=line.get_color())
    for target_id, path in summary.series.targets.items():
        xy = np.asarray(path)
        axes.plot(xy[:, 0], xy[:, 1], linewidth=0.8, linestyle=":", color="#2e7d4f")
        axes.annotate(f"T{target_id}", xy[-1], fontsize=8, color="#2e7d4f")
    axes.set(xlabel="x east (m)", ylabel="y north (m)", aspect="equal", title="Paths")
    axes.legend(fontsize=8, loc="best")
    return _png(figure)


def course_figure(summary: Summary) -> bytes:
    """Return the course of the mission: trace, attacks, weights, solve time."""
    series = summary.series
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    trace, attacks, weights, solve = figure.subplots(4, 1, sharex=True)
    _trace(trace, summary)
    attacks.step(series.time_s, series.sensing_attacks, where="post", color=ZONE_COLOURS["sensing"])
    attacks.step(
        series.time_s,
        series.communication_attacks,
        where="post",
        color=ZONE_COLOURS["communication"],
    )
    attacks.legend(["sensing", "communication"], fontsize=8, loc="upper left")
    attacks.set_ylabel("attacks so far")
    for name, values in series.weights.items():
        weights.step(series.time_s, values, where="post", label=name)
    weights.set(ylabel="weights", yscale="log")
    weights.legend(fontsize=8, ncols=4, loc="upper left")
    solve.plot(series.time_s, _numbers(series.solve_ms), linewidth=0.6, color=_TRACE)
    solve.set(ylabel="solve (ms)", xlabel="mission time (s)")
    return _png(figure)


def assignment_figure(summary: Summary) -> bytes:
    """Return who tracked what when: one row per robot and target."""
    series = summary.series
    pairs = sorted(
        {(int(r), t) for matrix in series.assignments for r, row in matrix.items() for t in row}
    )
    figure = Figure(figsize=(9.0, 0.9 + 0.28 * max(1, len(pairs))), layout="constrained")
    axes = figure.subplots()
    for row, (robot_id, target_id) in enumerate(pairs):
        axes.broken_barh(_spans(series, robot_id, target_id), (row - 0.35, 0.7), color="#5b7fa6")
    axes.set_yticks(range(len(pairs)), [f"robot {r}, target {t}" for r, t in pairs], fontsize=8)
    axes.set(xlabel="mission time (s)", title="Assignment")
    return _png(figure)


def _trace(axes: Axes, summary: Summary) -> None:
    series = summary.series
    axes.plot(series.time_s, _numbers(series.trace), color=_TRACE, linewidth=1.0)
    axes.fill_between(
        series.time_s,
        0.0,
        1.0,
        where=[count > 0 for count in series.failed],
        step="post",
        transform=axes.get_xaxis_transform(),
        color=_FAILED,
        alpha=0.15,
        linewidth=0.0,
    )
    for story in summary.comments:
        axes.axvline(story.comment["time_s"], color="#6a3fa0", linestyle="--", linewidth=1.0)
    axes.set(ylabel="trace (m²)", title="Course (shaded: a robot failing; dashed: comments)")


def _draw_zone(axes: Axes, zone: dict[str, object]) -> None:
    _, vectors = np.linalg.eigh(np.asarray(zone["covariance"], dtype=float))
    long, short = np.asarray(zone["keep_out_axes_m"], dtype=float)
    angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    centre = np.asarray(zone["mean"], dtype=float)
    colour = ZONE_COLOURS[str(zone["kind"])]
    axes.add_patch(
        Ellipse(
            (float(centre[0]), float(centre[1])),
            2.0 * float(long),
            2.0 * float(short),
            angle=angle,
            facecolor=colour,
            edgecolor=colour,
            alpha=0.2,
        )
    )
    axes.annotate(str(zone["id"]), (float(centre[0]), float(centre[1])), fontsize=8, color=colour)


def _spans(series: Series, robot_id: int, target_id: int) -> list[tuple[float, float]]:
    """Return (start, length) of every stretch in which a pair was assigned."""
    spans: list[tuple[float, float]] = []
    start: float | None = None
    for time_s, matrix in zip(series.time_s, series.assignments, strict=True):
        held = target_id in matrix.get(str(robot_id), [])
        if held and start is None:
            start = time_s
        elif not held and start is not None:
            spans.append((start, time_s - start))
            start = None
    if start is not None:
        spans.append((start, series.time_s[-1] - start))
    return spans


def _numbers(values: list[float | None]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def _png(figure: Figure) -> bytes:
    FigureCanvasAgg(figure)
    picture = BytesIO()
    figure.savefig(picture, format="png", dpi=DPI, bbox_inches="tight", metadata={"Software": None})
    return picture.getvalue()
