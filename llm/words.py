"""Small pieces of plain English that prompts and violations share."""

import math
from collections.abc import Iterable, Sequence


def listed(parts: Sequence[str]) -> str:
    """Join as people do: "a", "a and b", "a, b and c"."""
    if len(parts) <= 1:
        return "".join(parts)
    return f"{', '.join(parts[:-1])} and {parts[-1]}"


def drone(robot_id: int) -> str:
    """Name one robot."""
    return f"Drone {robot_id}"


def drones(robot_ids: Iterable[int]) -> str:
    """Name several robots."""
    return listed([drone(robot_id) for robot_id in robot_ids])


def target(target_id: int) -> str:
    """Name one target."""
    return f"Target {target_id}"


def targets(target_ids: Iterable[int]) -> str:
    """Name several targets."""
    return listed([target(target_id) for target_id in target_ids])


def number(value: float) -> str:
    """Write a number briefly: four significant digits, no trailing zeros, no exponent."""
    text = f"{value:.4g}"
    if "e" in text:
        decimals = max(0, 3 - math.floor(math.log10(abs(value))))
        text = f"{value:.{decimals}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def at_least(lower: float) -> str:
    """Write a lower bound briefly, rounded so that the number written keeps it."""
    return _rounded(lower, -1.0)


def at_most(upper: float) -> str:
    """Write an upper bound briefly, rounded so that the number written keeps it."""
    return _rounded(upper, 1.0)


def _rounded(bound: float, side: float) -> str:
    text = number(bound)
    if (float(text) - bound) * side <= 0.0:
        return text
    unit = 10.0 ** (math.floor(math.log10(abs(bound))) - 3)
    inner = number(bound - side * unit)
    return inner if (float(inner) - bound) * side <= 0.0 else repr(bound)


def cut(text: str, length: int) -> str:
    """Shorten a text to at most `length` characters, saying so."""
    return text if len(text) <= length else f"{text[: length - 3]}..."


def writable(text: str) -> str:
    """Return a text that UTF-8 can hold: half a surrogate pair, as JSON can spell it, becomes ?."""
    return text.encode("utf-8", "replace").decode("utf-8")
