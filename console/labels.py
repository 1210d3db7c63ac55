"""Where names stand in the scene, so that they do not cover each other.

A label belongs beside its thing. Where two would overlap, the less important one goes to another
side, then farther away on a leader line. Overlap is judged as seen by the camera that a new viewer
gets; a label comes back to a better side only when there is room to spare, so that it rests.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from typing import Final

import numpy as np

from console.camera import Lens, Point3
from console.shapes import Floats

GLYPH: Final = 0.62
"""Width of a letter, in heights of the text."""

TEXT: Final = 0.038
"""Height of a line of text, with the space around it, in heights of the picture."""

MAX_LABELS: Final = 64
"""More would hide the scene; and to place them takes milliseconds of the event loop."""

SPARE: Final = 0.4
"""Room around it that lets a label come back to a better side, in heights of the text."""

_ROOM: Final = SPARE * TEXT * np.array([-1.0, -1.0, 1.0, 1.0])
_BESIDE: Final = (
    (0.0, 1.4), (0.0, -1.4), (1.2, 0.0), (-1.2, 0.0),
    (1.1, 1.4), (-1.1, 1.4), (1.1, -1.4), (-1.1, -1.4),
)  # fmt: skip
_AWAY: Final = tuple(
    (across, up)
    for lines in (2.6, 3.8, 5.0, 6.2)
    for up in (lines, -lines)
    for across in (0.0, 1.3, -1.3, 2.6, -2.6)
)
_SIDES: Final = np.array(_BESIDE + _AWAY)
"""Where a label may stand, the best first: steps across (in half widths) and up (in lines). Those
away from the thing need a leader line."""


@dataclass(frozen=True, slots=True)
class Label:
    """A name that wants to stand beside a place."""

    key: str
    text: str
    place: Point3
    rank: int
    """Smaller ones choose first."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A label where it stands: its middle in space, and whether a line must lead there."""

    text: str
    position: Point3
    led: bool


@dataclass(slots=True)
class Declutter:
    """Owner of where each label stood last."""

    _sides: dict[str, int] = field(default_factory=dict)

    def place(self, labels: Iterable[Label], lens: Lens) -> dict[str, Placed]:
        """Return where the labels stand, by key; of too many, those ranks that find room."""
        wanted = _most_important(labels)
        boxes = _boxes(wanted, lens)
        claimed = self._claimed(wanted, boxes)
        taken: Floats = np.zeros(claimed.shape[1:])
        sides: dict[str, int] = {}
        found = {}
        for row, label in enumerate(wanted):
            side = _best(taken[row])
            _take(taken[row + 1 :], claimed[:, row + 1 :], boxes[row, side].tolist())
            sides[label.key] = side
            away = side >= len(_BESIDE)
            found[label.key] = Placed(label.text, _position(label, side, lens), led=away)
        self._sides = sides
        return found

    def _claimed(self, labels: list[Label], boxes: Floats) -> Floats:
        """Return what each label asks for on each side, shape (4, labels, sides).

        That is its box, with room to spare on sides better than where it stands.
        """
        claimed = boxes.copy()
        for row, label in enumerate(labels):
            last = self._sides.get(label.key, 0)
            claimed[row, :last] += _ROOM
        return np.ascontiguousarray(np.moveaxis(claimed, -1, 0))


def leaders(labels: Iterable[Label], placed: Mapping[str, Placed]) -> list[tuple[Point3, Point3]]:
    """Return the lines from things to those of their labels that stand away from them."""
    return [
        (label.place, placed[label.key].position)
        for label in labels
        if label.key in placed and placed[label.key].led
    ]


def _most_important(labels: Iterable[Label]) -> list[Label]:
    """Return the labels in the order in which they choose: all of a rank, or none."""
    found: list[Label] = []
    ordered = sorted(labels, key=lambda label: (label.rank, label.key))
    for _, group in groupby(ordered, key=lambda label: label.rank):
        rank = list(group)
        if len(found) + len(rank) > MAX_LABELS:
            break
        found += rank
    return found


def _position(label: Label, side: int, lens: Lens) -> Point3:
    """Return the middle of a label that stands on a side of its thing."""
    across, up = _SIDES[side].tolist()
    return lens.beside(label.place, across * _reach(label), up * TEXT)


def _boxes(labels: list[Label], lens: Lens) -> Floats:
    """Return what each label would cover of the picture on each side.

    Shape (labels, sides, 4): left, bottom, right, top.
    """
    centres = np.array([lens.seen(label.place) for label in labels]).reshape(-1, 1, 2)
    halves = np.array([_half(label) for label in labels])[:, None]
    reaches = np.array([_reach(label) for label in labels])[:, None]
    middles = centres[..., 0] + _SIDES[:, 0] * reaches
    lines = centres[..., 1] + _SIDES[:, 1] * TEXT
    return np.stack(
        [middles - halves, lines - 0.5 * TEXT, middles + halves, lines + 0.5 * TEXT], axis=-1
    )


def _half(label: Label) -> float:
    """Return half the width of a label in the picture."""
    return 0.5 * GLYPH * TEXT * len(label.text)


def _reach(label: Label) -> float:
    """Return how far a step across goes in the picture: half the label and a gap."""
    return _half(label) + 0.35 * TEXT


def _best(taken: Floats) -> int:
    """Return the first side beside the thing of which nothing is taken, else the least taken."""
    beside, away = taken[: len(_BESIDE)], taken[len(_BESIDE) :]
    best = int(beside.argmin())  # the first one of the least
    if beside[best] > 0.0:
        farther = int(away.argmin())
        if away[farther] < beside[best]:
            return len(_BESIDE) + farther
    return best


def _take(taken: Floats, claimed: Floats, box: list[float]) -> None:
    """Add the area that a box (left, bottom, right, top) takes of every claim.

    `taken` has shape (labels, sides), `claimed` (4, labels, sides): one pass over all labels that
    have yet to choose, since a pass for each of them would hold up the event loop.
    """
    left, bottom, right, top = box
    widths = np.minimum(claimed[2], right) - np.maximum(claimed[0], left)
    heights = np.minimum(claimed[3], top) - np.maximum(claimed[1], bottom)
    taken += np.maximum(widths, 0.0) * np.maximum(heights, 0.0)
