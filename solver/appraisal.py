"""What a whole assignment is worth, with the information of all robots put together."""

import numpy as np

from solver.arrays import BoolArray, FloatArray, IntArray
from solver.prospects import AssignmentSettings, Prospects
from solver.roster import UNCOVERED, UNSIGHTED, Roster

Row = tuple[int, tuple[int, ...]]
"""A robot and its targets, both as rows of the roster."""


class Appraisal:
    """The full price of assignments: coverage, trace with all robots' information, changes."""

    def __init__(self, roster: Roster, prospects: Prospects, settings: AssignmentSettings) -> None:
        self._roster, self._prospects, self._settings = roster, prospects, settings
        self._informing = roster.free & roster.seeing
        self._rows: dict[Row, FloatArray] = {}

    def prices(self, matrices: BoolArray) -> FloatArray:
        """Return the prices (B,) of assignment matrices (B, M, N)."""
        roster, steps = self._roster, self._settings.steps
        batch, _, count = matrices.shape
        rows = [
            (b, (i, tuple(np.flatnonzero(matrices[b, i]).tolist())))
            for b, i in np.argwhere(matrices.any(axis=2) & self._informing).tolist()
        ]
        self._learn([row for _, row in rows])
        summed = np.zeros((steps, batch, count, 2, 2))
        # What a jammed robot sees reaches nobody: it covers, and informs nobody.
        for b, row in rows:
            summed[:, b, list(row[1])] += self._rows[row]
        trace = self._prospects.traces(summed).sum(axis=1)
        held = matrices.any(axis=1).sum(axis=1)
        seen = (matrices & roster.seeing[:, None]).any(axis=1).sum(axis=1)
        changes = (matrices & ~roster.current).sum(axis=(1, 2))
        lack = UNCOVERED * (count - held) + UNSIGHTED * (count - seen)
        return np.asarray(lack + trace + self._settings.switching_cost * changes)

    def _learn(self, rows: list[Row]) -> None:
        """Keep the information (K, n, 2, 2) of rows not met before."""
        new = [row for row in dict.fromkeys(rows) if row not in self._rows]
        if not new:
            return
        robots, members = padded(new)
        _, gained = self._prospects.row(robots, members)
        for (robot, targets), each in zip(new, gained, strict=True):
            self._rows[robot, targets] = np.moveaxis(each[: len(targets)], 1, 0)


def padded(rows: list[Row]) -> tuple[IntArray, IntArray]:
    """Return rows as robots (B,) and members (B, C) filled up with -1."""
    widest = max(1, max(len(targets) for _, targets in rows))
    members = np.full((len(rows), widest), -1, dtype=np.int64)
    for at, (_, targets) in enumerate(rows):
        members[at, : len(targets)] = targets
    return np.array([robot for robot, _ in rows], dtype=np.int64), members
