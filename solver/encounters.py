"""Where robots were attacked and where they were not: bounded, whatever a mission lasts.

One kind of attack. Evidence is summed up in the cells of a grid over the field, each with its
centre of gravity, so that a cell's size costs little; it fades, since zones may move. Frame ENU,
metres, seconds.
"""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from solver.arrays import FloatArray, IntArray
from solver.zones import Point

CELL_M = 0.25
"""Side of a cell, unless the field is too large for so small ones."""

MOST_CELLS = 512
"""Along each axis."""

MOST_MARKS = 100
"""Of one layer in one window; more are put together in larger cells."""

_LARGEST_GAIN = 1e12
_LONGEST_FADE = 600.0
"""Memories that pass at once: exp() must not overflow, and nothing is left after so many."""


class Layer(IntEnum):
    """What a mark tells of its place."""

    CLEAR = 0
    """Seconds there without being hit."""

    HIT = 1
    """Hits there."""

    INSIDE = 2
    """A failure went on there though nothing hit: some zone reaches as far."""

    OUTSIDE = 3
    """A failure ended there: no zone reaches as far."""


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """n places and how much each of them counts."""

    points: FloatArray
    """(n, 2) metres."""

    weights: FloatArray
    """(n,): seconds, hits, or at most 1 for a place that was inside or outside."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """All marks in one window."""

    clear: Marks
    hits: Marks
    inside: Marks
    outside: Marks


class Encounters:
    """Owner of one kind's evidence.

    Args:
        lower: South-west corner of the field; marks beyond it count in the cells at the rim.
        upper: North-east corner.
        memory_s: Time after which evidence counts for 1/e.
    """

    def __init__(self, lower: Point, upper: Point, memory_s: float) -> None:
        width = max(upper[0] - lower[0], upper[1] - lower[1])
        self.cell_m = max(CELL_M, width / MOST_CELLS)
        self._lower = np.asarray(lower, dtype=np.float64)
        self._shape = tuple(
            max(1, math.ceil((upper[axis] - lower[axis]) / self.cell_m)) for axis in (0, 1)
        )
        self._memory_s = memory_s
        # New evidence is made to count more instead of all old one less: no sweep per tick.
        self._gain = 1.0
        # Per layer and cell the weight, and the weighted sums of x and y.
        self._sums = np.zeros((len(Layer), *self._shape, 3))

    def fade(self, elapsed_s: float) -> None:
        """Let time pass, any length of it."""
        self._gain *= math.exp(min(elapsed_s / self._memory_s, _LONGEST_FADE))
        if self._gain > _LARGEST_GAIN:
            self._sums /= self._gain
            self._gain = 1.0

    def add(self, layer: Layer, points: FloatArray, weights: FloatArray) -> None:
        """Take marks at points (n, 2) with weights (n,)."""
        counted = np.column_stack([np.ones(len(points)), points])
        cells = self._cells(points)
        np.add.at(self._sums[layer], cells, counted * (weights * self._gain)[:, None])

    def forget(self, centre: Point, radius_m: float) -> None:
        """Let go of all that is known within a square around a place."""
        columns, rows = self._window(centre, radius_m)
        self._sums[:, columns, rows] = 0.0

    def near(self, centre: Point, radius_m: float) -> Evidence:
        """Return the marks within a square around a place."""
        columns, rows = self._window(centre, radius_m)
        window = self._sums[:, columns, rows]
        clear, hits, inside, outside = (_marks(window[layer], self._gain) for layer in Layer)
        # Whether a place is inside is the same however often it is asked.
        return Evidence(clear, hits, _once(inside), _once(outside))

    def _cells(self, points: FloatArray) -> tuple[IntArray, IntArray]:
        cells = np.floor((points - self._lower) / self.cell_m).astype(np.intp)
        nx, ny = self._shape
        return np.clip(cells[:, 0], 0, nx - 1), np.clip(cells[:, 1], 0, ny - 1)

    def _window(self, centre: Point, radius_m: float) -> tuple[slice, slice]:
        corners = np.asarray(centre) + np.array([[-radius_m], [radius_m]])
        i, j = self._cells(corners)
        return slice(int(i[0]), int(i[1]) + 1), slice(int(j[0]), int(j[1]) + 1)


def _marks(window: FloatArray, gain: float) -> Marks:
    """Return the occupied cells of a window (nx, ny, 3), put together until they are few."""
    found = window[..., 0] > 0.0
    while np.count_nonzero(found) > MOST_MARKS:
        window = _halved(window)
        found = window[..., 0] > 0.0
    sums = window[found]
    return Marks(sums[:, 1:] / sums[:, :1], sums[:, 0] / gain)


def _halved(window: FloatArray) -> FloatArray:
    """Return a window of half the resolution."""
    nx, ny, _ = window.shape
    padded = np.pad(window, ((0, nx % 2), (0, ny % 2), (0, 0)))
    pairs = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2, 3)
    return np.asarray(pairs.sum(axis=(1, 3)))


def _once(marks: Marks) -> Marks:
    return Marks(marks.points, np.minimum(marks.weights, 1.0))
