"""Figures as PNG. Drawn without a display; nothing global is changed."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from server.experiments.statistics import Estimate

DPI = 150
COLOURS = ("#7f8c8d", "#2c7fb8", "#d95f0e", "#31a354", "#756bb1", "#c51b8a", "#636363", "#fdae6b")
"""Told apart in grey too; the first is the base line's."""


@dataclass(frozen=True, slots=True)
class Bar:
    """One row in a panel."""

    label: str
    mean: Estimate | None
    points: Sequence[float] = ()
    """Single values, one per seed."""


def canvas(width: float, height: float) -> Figure:
    """Return an empty figure of so many inches with a canvas of its own."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png(figure: Figure) -> bytes:
    """Return a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()


def bars(panels: Mapping[str, Sequence[Bar]], title: str) -> bytes:
    """Draw one panel per figure: a bar per row, its 95 % interval, a dot per seed."""
    figure = canvas(3.1 * len(panels), 3.9)
    figure.suptitle(title)
    for axes, (name, rows) in zip(
        figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True
    ):
        _bar_panel(axes, rows)
        axes.set_title(name, fontsize=10)
    return png(figure)


def _bar_panel(axes: Axes, rows: Sequence[Bar]) -> None:
    for place, row in enumerate(rows):
        colour = COLOURS[place % len(COLOURS)]
        if row.mean is not None:
            axes.bar(
                place,
                row.mean.mean,
                yerr=row.mean.half_width or 0.0,
                color=colour,
                alpha=0.75,
                capsize=3,
            )
        count = len(row.points)
        spread = [place - 0.25 + 0.5 * (i + 0.5) / count for i in range(count)]
        axes.plot(spread, row.points, ".", color="black", markersize=2.5, alpha=0.5)
    axes.set_xticks(
        range(len(rows)), [row.label for row in rows], rotation=35, ha="right", fontsize=8
    )
    axes.grid(axis="y", alpha=0.3)


@dataclass(frozen=True, slots=True)
class Mark:
    """A point with intervals both ways."""

    label: str
    x: Estimate
    y: Estimate


def trade_off(
    curve: Sequence[Mark], rows: Sequence[Mark], labels: tuple[str, str], title: str
) -> bytes:
    """Draw a curve of settings and the rows beside it."""
    figure = canvas(6.4, 4.8)
    axes = figure.subplots()
    axes.plot([m.x.mean for m in curve], [m.y.mean for m in curve], "-", color=COLOURS[0], zorder=1)
    for mark in curve:
        axes.errorbar(*_cross(mark), fmt="o", color=COLOURS[0], markersize=4, alpha=0.8)
        axes.annotate(
            mark.label,
            (mark.x.mean, mark.y.mean),
            textcoords="offset points",
            xytext=(4, 4),
            fontsize=7,
        )
    for place, mark in enumerate(rows, start=1):
        axes.errorbar(
            *_cross(mark),
            fmt="s",
            color=COLOURS[place % len(COLOURS)],
            markersize=6,
            capsize=3,
            label=mark.label,
        )
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.set_title(title)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return png(figure)


def _cross(mark: Mark) -> tuple[float, float, float, float]:
    """Return x, y and the half widths in the order of errorbar: y first."""
    return mark.x.mean, mark.y.mean, mark.y.half_width or 0.0, mark.x.half_width or 0.0


@dataclass(frozen=True, slots=True)
class Line:
    """A curve over a common axis."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    dashed: bool = False


def lines(curves: Sequence[Line], labels: tuple[str, str], title: str) -> bytes:
    """Draw curves on logarithmic axes."""
    figure = canvas(6.4, 4.8)
    axes = figure.subplots()
    for place, curve in enumerate(curves):
        style = "--" if curve.dashed else "o-"
        axes.loglog(
            curve.x,
            curve.y,
            style,
            color=COLOURS[place % len(COLOURS)],
            markersize=4,
            label=curve.label,
        )
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.set_title(title)
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
    return png(figure)
