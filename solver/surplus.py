"""Second robots on targets, where capacity is to spare: two lines of sight see better.

For large teams, after every target has its first robot.
"""

import numpy as np
from scipy.spatial import cKDTree

from solver.appraisal import Row, padded
from solver.arrays import BoolArray, FloatArray, IntArray
from solver.prospects import AssignmentSettings, Prospects
from solver.roster import Roster

_NEAREST = 8
_ROUNDS = 50
_WORTH = 1e-9


def topped_up(
    roster: Roster, prospects: Prospects, settings: AssignmentSettings, matrix: BoolArray
) -> BoolArray:
    """Return the matrix with second robots added, moved and taken away as long as it helps.

    One robot's row changes at a time: a near target more where there is room, one less or one
    for another where somebody else holds it too. What a change does to the robot's other
    targets counts. All candidates are priced at once; those made touch no common target.
    """
    matrix = matrix.copy()
    held = _Held(roster, prospects, matrix)
    for _ in range(_ROUNDS):
        trials = _trials(roster, prospects, matrix)
        if not trials:
            break
        # Targets let go stand in the row too, with nothing gained.
        rows = [(i, tuple(sorted({*_own(matrix, i), *targets}))) for i, targets in trials]
        gained = held.at(rows, _promised(prospects, trials))
        robots, members = padded(rows)
        gains = held.gains(robots, members, gained)
        touched = np.zeros(len(roster.target_ids), dtype=np.bool_)
        done = np.zeros(len(roster.free), dtype=np.bool_)
        for at in np.argsort(-gains, kind="stable").tolist():
            (robot, targets), (_, wide) = trials[at], rows[at]
            new = sum(not roster.current[robot, j] for j in targets)
            new -= int((matrix[robot] & ~roster.current[robot]).sum())
            if gains[at] <= settings.switching_cost * new + _WORTH:
                continue
            if done[robot] or touched[list(wide)].any():
                continue
            done[robot] = touched[list(wide)] = True
            matrix[robot] = False
            matrix[robot, list(targets)] = True
            held.replace(robot, wide, gained[:, at, : len(wide)])
        if not done.any():
            break
    return matrix


class _Held:
    """What each target gets from whom, under a matrix that changes."""

    def __init__(self, roster: Roster, prospects: Prospects, matrix: BoolArray) -> None:
        self._prospects = prospects
        steps = prospects.steps
        self._own = np.zeros((steps, *matrix.shape, 2, 2))
        rows = [
            (i, tuple(np.flatnonzero(matrix[i]).tolist()))
            for i in np.flatnonzero(matrix.any(axis=1) & roster.free & roster.seeing).tolist()
        ]
        if rows:
            gained = np.moveaxis(prospects.row(*padded(rows))[1], 2, 0)
            for at, (robot, targets) in enumerate(rows):
                self._own[:, robot, list(targets)] = gained[:, at, : len(targets)]
        self._all = self._own.sum(axis=1)

    def at(self, rows: list[Row], promised: list[dict[int, FloatArray]]) -> FloatArray:
        """Return information (K, B, C, 2, 2) of rows from what their targets are promised."""
        widest = max(len(targets) for _, targets in rows)
        result = np.zeros((len(self._own), len(rows), widest, 2, 2))
        for b, ((_, targets), gained) in enumerate(zip(rows, promised, strict=True)):
            for c, target in enumerate(targets):
                if target in gained:
                    result[:, b, c] = gained[target]
        return result

    def gains(self, robots: IntArray, members: IntArray, gained: FloatArray) -> FloatArray:
        """Return by how much rows (B, C) lower the accumulated trace, (B,)."""
        real = members >= 0
        targets = np.where(real, members, 0)
        before = self._all[:, targets]
        after = before - self._own[:, robots[:, None], targets] + gained
        traces = self._prospects.traces_of(targets, before)
        traces = traces - self._prospects.traces_of(targets, after)
        return np.asarray((traces * real).sum(axis=1))

    def replace(self, robot: int, targets: tuple[int, ...], gained: FloatArray) -> None:
        """Take note of a robot's new row."""
        chosen = list(targets)
        self._all[:, chosen] += gained - self._own[:, robot, chosen]
        self._own[:, robot, chosen] = gained


def _own(matrix: BoolArray, robot: int) -> list[int]:
    return np.flatnonzero(matrix[robot]).tolist()


def _promised(prospects: Prospects, trials: list[Row]) -> list[dict[int, FloatArray]]:
    """Return for each row the information (K, 2, 2) about each of its targets."""
    _, gained = prospects.row(*padded(trials))
    return [
        dict(zip(targets, each, strict=False))
        for (_, targets), each in zip(trials, gained, strict=True)
    ]


def _trials(roster: Roster, prospects: Prospects, matrix: BoolArray) -> list[Row]:
    ready = np.flatnonzero(roster.free & roster.seeing & (roster.capacity > 0))
    placed = np.flatnonzero(roster.placed)
    if not len(ready) or not len(placed):
        return []
    # A target that only this robot sees must stay with it.
    shared = (matrix & roster.seeing[:, None]).sum(axis=0) > 1
    count = min(_NEAREST, len(placed))
    _, near = cKDTree(prospects.targets[placed]).query(prospects.robots[ready], k=count)
    trials = []
    for robot, row in zip(
        ready.tolist(), placed[near.reshape(len(ready), -1)].tolist(), strict=True
    ):
        own = _own(matrix, robot)
        wanted = [j for j in row if not (matrix[robot, j] or roster.forbidden[robot, j])]
        spare = [j for j in own if shared[j] and not roster.fixed[robot, j]]
        if len(own) < roster.capacity[robot]:
            trials += [(robot, tuple(sorted((*own, j)))) for j in wanted]
        for given_up in spare:
            rest = [j for j in own if j != given_up]
            trials.append((robot, tuple(rest)))
            trials += [(robot, tuple(sorted((*rest, j)))) for j in wanted]
    return trials
