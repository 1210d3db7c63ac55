"""The sightings of one moment as columns, ready for stacked arithmetic."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from solver.arrays import BoolArray, FloatArray, IntArray
from solver.observations import Detections

FARTHEST = 1e7
"""Metres or radians: beyond them a place, range or bearing is no measurement, and squares of
squares overflow before long."""


@dataclass(frozen=True, slots=True)
class Sightings:
    """n sightings of known ids, all numbers ordinary. Every array has the shape (n,)."""

    rows: IntArray
    """Which target, by its place in the mission."""

    x: FloatArray
    """Where the robot was, m."""

    y: FloatArray
    range: FloatArray
    """m; slightly negative at times, when noise outweighs a short distance."""

    bearing: FloatArray
    """rad, from the robot to the target."""

    def __len__(self) -> int:
        return len(self.rows)

    def select(self, which: BoolArray | IntArray) -> "Sightings":
        """Return some of them."""
        return Sightings(
            self.rows[which], self.x[which], self.y[which], self.range[which], self.bearing[which]
        )


def gathered(ids: tuple[int, ...], batch: tuple[Detections, ...]) -> Sightings:
    """Return the usable sightings of a batch: of these targets, no number beyond `FARTHEST`."""
    index = {target_id: row for row, target_id in enumerate(ids)}
    flat = []
    for detections in batch:
        x, y = detections.position
        for sighting in detections.sightings:
            row = index.get(sighting.target_id)
            if row is not None:
                flat.append((row, x, y, sighting.range_m, sighting.bearing_rad))
    table = np.array(flat, dtype=np.float64).reshape(-1, 5)
    # A comparison with NaN is false, so this finds everything that is no ordinary number.
    usable = (np.abs(table[:, 1:]) <= FARTHEST).all(axis=1)
    if not usable.all():
        table = table[usable]
    columns = np.ascontiguousarray(table.T)
    return Sightings(columns[0].astype(np.int64), *columns[1:])


def layers(sightings: Sightings) -> Iterator[IntArray]:
    """Yield indices of sightings, each target at most once in a layer, in the batch's order."""
    order = np.argsort(sightings.rows, kind="stable")
    rows = sightings.rows[order]
    first = np.searchsorted(rows, rows)
    rank = np.arange(len(rows)) - first
    for layer in range(int(rank.max(initial=-1)) + 1):
        yield order[rank == layer]
