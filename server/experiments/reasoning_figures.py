"""The paper's figure: success rate above, tokens below, task model left, action model right."""

from collections.abc import Sequence

from matplotlib.axes import Axes

from llm.styles import Loop
from server.experiments.figures import COLOURS, canvas, png
from server.experiments.reasoning import CellKey, Reasoning, Score

_ROOM = 0.8
"""Of the distance between two cells, for the bars of all models."""


def draw(reasoning: Reasoning) -> dict[str, bytes]:
    """Return the figure as PNG by the name of its file."""
    figure = canvas(12.0, 7.0)
    figure.suptitle("Success rate and tokens by task load and number of zones")
    axes = figure.subplots(2, 2, squeeze=False)
    cells = list(reasoning.cells())
    for column, loop in enumerate(Loop):
        scored = [(key, (task, action)[column]) for key, task, action in cells]
        _success(axes[0][column], scored)
        _tokens(axes[1][column], scored)
        axes[0][column].set_title(f"{loop.value} model")
    axes[0][0].set_ylabel("valid (%): at once, and after retries (pale)")
    axes[1][0].set_ylabel("tokens of one answer")
    axes[0][0].legend(fontsize=8, loc="lower left")
    return {"reasoning": png(figure)}


def _success(axes: Axes, scored: Sequence[tuple[CellKey, Score]]) -> None:
    for place, width, label, colour, score in _bars(axes, scored):
        axes.bar(place, score.valid, width, color=colour, alpha=0.35)
        axes.bar(place, score.valid_first, width, color=colour, label=label)
    axes.set_ylim(0.0, 108.0)


def _tokens(axes: Axes, scored: Sequence[tuple[CellKey, Score]]) -> None:
    for place, width, label, colour, score in _bars(axes, scored):
        axes.bar(place, score.tokens_out, width, color=colour, label=label)


def _bars(
    axes: Axes, scored: Sequence[tuple[CellKey, Score]]
) -> list[tuple[float, float, str | None, str, Score]]:
    """Return place, width, label, colour and score of each bar, and mark the cells below."""
    series = list(dict.fromkeys((key.name, key.examples) for key, _ in scored))
    places = sorted({(key.targets, key.zones) for key, _ in scored})
    width = _ROOM / max(1, len(series))
    bars = []
    named: set[int] = set()
    for key, score in scored:
        number = series.index((key.name, key.examples))
        place = places.index((key.targets, key.zones)) + width * (number - 0.5 * (len(series) - 1))
        label = None if number in named else f"{key.name}, {key.examples} example"
        named.add(number)
        bars.append((place, 0.95 * width, label, COLOURS[number % len(COLOURS)], score))
    words = [f"{targets} targets\n{zones} zones" for targets, zones in places]
    axes.set_xticks(range(len(places)), words, fontsize=7)
    axes.grid(axis="y", alpha=0.3)
    return bars
