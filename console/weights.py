"""The weights: the logarithmic scale between their bounds, and their history as small curves."""

import math
from typing import Any, Final

from console.ledger import Ledger, WeightStep
from console.render import WEIGHT_WORDS, clock, escape, since

Json = dict[str, Any]
Span = tuple[float, float]

HISTORY_S: Final = 300.0
"""So many seconds are shown."""

WIDTH, HEIGHT = 120.0, 22.0
STEPS: Final = 1000
"""Positions of a slider from the lower to the upper bound."""


def note(snapshot: Json) -> str:
    """Return who asked for the weights, and since when they stand."""
    return since(snapshot, "weights")


def position(value: float, bounds: Span) -> float:
    """Return where a value lies between its bounds on the logarithmic scale, 0 to STEPS."""
    lower, upper = bounds
    if not 0.0 < lower < upper or value <= 0.0:
        return 0.5 * STEPS
    share = math.log(value / lower) / math.log(upper / lower)
    return STEPS * min(1.0, max(0.0, share))


def value_at(where: float, bounds: Span) -> float:
    """Return the value at a slider's position, to three digits and never outside the bounds."""
    lower, upper = bounds
    if not 0.0 < lower < upper:
        return lower
    value = lower * (upper / lower) ** (min(STEPS, max(0.0, where)) / STEPS)
    return min(upper, max(lower, float(f"{value:.3g}")))


def problem(name: str, value: float | None, bounds: Span) -> str:
    """Return what is wrong with a value, "" for nothing."""
    title = WEIGHT_WORDS.get(name, name)
    span = f"from {bounds[0]:g} to {bounds[1]:g}"
    if value is None or not math.isfinite(value):
        return f"{title}: a number {span}."
    if not bounds[0] <= value <= bounds[1]:
        return f"{title}: {value:g} is not {span}."
    return ""


def history(snapshot: Json, ledger: Ledger, name: str) -> str:
    """Return the last minutes of one weight as a curve, and who set it last."""
    directives = snapshot["directives"]
    now_s = snapshot["time_s"] or 0.0
    bounds = tuple(directives["weight_bounds"][name])
    steps = [step for step in ledger.weight_steps(now_s) if name in step.after]
    points = _curve(steps, name, directives["weights"][name], now_s, bounds)
    if steps:
        last = steps[-1].credit
        words = f"{last.who.removeprefix('the ')}, {clock(last.time_s)}"
    else:
        words = "as in the scenario"
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return (
        f'<svg class="spark" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" preserveAspectRatio="none"'
        f' role="img" aria-label="the last {HISTORY_S / 60:g} minutes">'
        f'<polyline points="{line}"/></svg>'
        f'<small title="set by: {escape(words)}">{escape(words)}</small>'
    )


def _curve(
    steps: list[WeightStep], name: str, value: float, now_s: float, bounds: tuple[float, ...]
) -> list[tuple[float, float]]:
    """Return a weight over the last minutes as steps in the curve's own units."""
    span = (bounds[0], bounds[1])
    begin_s = now_s - HISTORY_S
    recent = [step for step in steps if step.credit.time_s > begin_s]
    first = recent[0].before[name] if recent else value
    points = [(0.0, _height(first, span))]
    for step in recent:
        x = WIDTH * (step.credit.time_s - begin_s) / HISTORY_S
        points += [(x, points[-1][1]), (x, _height(step.after[name], span))]
    return [*points, (WIDTH, points[-1][1])]


def _height(value: float, bounds: Span) -> float:
    """Return how far from the top a value is drawn."""
    return 1.5 + (HEIGHT - 3.0) * (1.0 - position(value, bounds) / STEPS)
