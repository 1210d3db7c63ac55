"""How the targets move, smoothed over a few seconds: what the gate expects of them."""

import math

import numpy as np

from solver.arrays import FloatArray
from solver.snapshot import Snapshot, TrackStatus

SMOOTHING_S = 4.0
"""Time constant. A step of the estimate is mostly noise; over some seconds it is motion."""

FASTEST_M_S = 5.0
"""A track that jumps was found elsewhere: it did not fly there."""


class Drift:
    """Owner of the targets' smoothed velocities. Feed it every snapshot in order."""

    def __init__(self, count: int) -> None:
        self._velocities = np.zeros((count, 2))
        self._places = np.zeros((count, 2))
        self._followed = np.zeros(count, dtype=bool)
        self._time_s: float | None = None

    @property
    def velocities(self) -> FloatArray:
        """(N, 2) m/s, in mission order."""
        return self._velocities.copy()

    def look(self, snapshot: Snapshot) -> None:
        """Take note of a snapshot. A filter that knows velocities is believed."""
        tracks = snapshot.tracks
        tracked = np.array([s is TrackStatus.TRACKED for s in tracks.status], dtype=bool)
        if self._time_s is not None and snapshot.time_s > self._time_s:
            self._smooth(tracks.positions, tracked, snapshot.time_s - self._time_s)
        if tracks.velocities.any():
            self._velocities = np.array(tracks.velocities)
        self._places, self._followed = np.array(tracks.positions), tracked
        self._time_s = snapshot.time_s

    def _smooth(self, places: FloatArray, tracked: np.ndarray, elapsed_s: float) -> None:
        moved = (places - self._places) / elapsed_s
        steady = tracked & self._followed & (np.hypot(*moved.T) < FASTEST_M_S)
        share = 1.0 - math.exp(-elapsed_s / SMOOTHING_S)
        self._velocities[steady] += share * (moved[steady] - self._velocities[steady])
        self._velocities[~tracked] *= 1.0 - share
