"""Local search on assignments: what one pair more, one less, or two exchanged would do."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from solver.appraisal import Appraisal, Row, padded
from solver.arrays import BoolArray, FloatArray, IntArray
from solver.prospects import AssignmentSettings, Prospects
from solver.roster import Roster

_ROUNDS = 200
_NEIGHBOURS = 8
_WORTH = 1e-9


def improved(
    roster: Roster,
    prospects: Prospects,
    settings: AssignmentSettings,
    starts: list[BoolArray],
) -> BoolArray:
    """Return the best matrix that single changes lead to from several starts.

    Changes: a pair more where there is room, a pair less, a target to another robot, two
    targets exchanged. For small teams: every change is appraised in full.
    """
    appraisal = Appraisal(roster, prospects, settings)
    ends = []
    for matrix in starts:
        price = float(appraisal.prices(matrix[None])[0])
        for _ in range(_ROUNDS):
            trials = _changes(roster, matrix)
            if not len(trials):
                break
            prices = appraisal.prices(trials)
            best = int(np.argmin(prices))
            if prices[best] >= price - _WORTH:
                break
            matrix, price = trials[best], float(prices[best])
        ends.append((price, matrix))
    return min(ends, key=lambda end: end[0])[1]


def _changes(roster: Roster, matrix: BoolArray) -> BoolArray:
    movable = matrix & ~roster.fixed & roster.free[:, None]
    addable = ~matrix & ~roster.forbidden & roster.free[:, None]
    room = (roster.capacity - matrix.sum(axis=1)).tolist()
    taken, open_pairs = np.argwhere(movable).tolist(), np.argwhere(addable).tolist()
    trials: list[list[tuple[int, int]]] = [[(i, j)] for i, j in taken]
    trials += [[(i, j)] for i, j in open_pairs if room[i] > 0]
    for i, j in open_pairs:
        trials += [[(i, j), (i, other)] for robot, other in taken if robot == i]
        if room[i] > 0:
            trials += [[(i, j), (robot, j)] for robot, other in taken if other == j]
    for at, (i, j) in enumerate(taken):
        trials += [
            [(i, j), (robot, other), (i, other), (robot, j)]
            for robot, other in taken[at + 1 :]
            if robot != i and addable[i, other] and addable[robot, j]
        ]
    changed = np.repeat(matrix[None], len(trials), axis=0)
    for at, flips in enumerate(trials):
        for i, j in flips:
            changed[at, i, j] = not changed[at, i, j]
    return changed


def swapped(
    roster: Roster, prospects: Prospects, settings: AssignmentSettings, matrix: BoolArray
) -> BoolArray:
    """Return the matrix after exchanges and moves between neighbours, for large teams.

    Rows are priced on their own (no target of these matrices is held twice but by decree), all
    trials of a round at once; of the trials that help, those that share no robot are made.
    """
    matrix = matrix.copy()
    able = np.flatnonzero(roster.free & roster.seeing)
    if len(able) < 2:
        return matrix
    pairs = _neighbours(prospects, able)
    rows = _Rows(roster, prospects, settings)
    stale = np.ones(len(roster.free), dtype=np.bool_)
    for _ in range(_ROUNDS):
        trials = [
            trial
            for i, k in pairs
            if stale[i] or stale[k]
            for trial in _exchanges(roster, matrix, i, k)
        ]
        stale[:] = False
        if not trials:
            break
        before = rows.prices([(i, _row(matrix, i)) for i in able.tolist()])
        own = dict(zip(able.tolist(), before.tolist(), strict=True))
        priced = rows.prices([part for trial in trials for part in trial]).reshape(-1, 2)
        gains = [
            own[first[0]] + own[second[0]] - float(both.sum())
            for (first, second), both in zip(trials, priced, strict=True)
        ]
        done = np.zeros(len(roster.free), dtype=np.bool_)
        for at in np.argsort(-np.array(gains), kind="stable").tolist():
            if gains[at] <= _WORTH:
                break
            (i, row), (k, other) = trials[at]
            if done[i] or done[k]:
                continue
            done[i] = done[k] = True
            matrix[i], matrix[k] = False, False
            matrix[i, list(row)] = True
            matrix[k, list(other)] = True
        stale |= done
    return matrix


class _Rows:
    """Prices of single rows, kept."""

    def __init__(self, roster: Roster, prospects: Prospects, settings: AssignmentSettings) -> None:
        self._roster, self._prospects, self._settings = roster, prospects, settings
        self._kept: dict[Row, float] = {}

    def prices(self, rows: list[Row]) -> FloatArray:
        """Return what rows cost against their targets being unseen, (len(rows),)."""
        new = list(dict.fromkeys(row for row in rows if row not in self._kept))
        if new:
            robots, members = padded(new)
            traces, _ = self._prospects.row(robots, members)
            real = members >= 0
            held = np.where(real, members, 0)
            saved = ((self._prospects.unseen[held] - traces) * real).sum(axis=1)
            changes = (real & ~self._roster.current[robots[:, None], held]).sum(axis=1)
            prices = self._settings.switching_cost * changes - saved
            self._kept.update(zip(new, prices.tolist(), strict=True))
        return np.array([self._kept[row] for row in rows])


def _row(matrix: BoolArray, robot: int) -> tuple[int, ...]:
    return tuple(np.flatnonzero(matrix[robot]).tolist())


def _neighbours(prospects: Prospects, able: IntArray) -> list[tuple[int, int]]:
    """Return pairs of robots near each other."""
    count = min(_NEIGHBOURS + 1, len(able))
    _, near = cKDTree(prospects.robots[able]).query(prospects.robots[able], k=count)
    pairs = {
        (min(i, k), max(i, k))
        for i, row in zip(able.tolist(), able[near].tolist(), strict=True)
        for k in row
        if i != k
    }
    return sorted(pairs)


def _exchanges(roster: Roster, matrix: BoolArray, i: int, k: int) -> Iterator[tuple[Row, Row]]:
    """Yield what becomes of two rows when targets change hands, one for one or one for none."""
    first, second = _row(matrix, i), _row(matrix, k)
    ours = [j for j in first if not roster.fixed[i, j] and _takes(roster, matrix, k, j)]
    theirs = [j for j in second if not roster.fixed[k, j] and _takes(roster, matrix, i, j)]
    for j in ours:
        if len(second) < roster.capacity[k]:
            yield (i, _without(first, j)), (k, tuple(sorted((*second, j))))
        for other in theirs:
            yield (
                (i, tuple(sorted((*_without(first, j), other)))),
                (k, tuple(sorted((*_without(second, other), j)))),
            )
    for other in theirs:
        if len(first) < roster.capacity[i]:
            yield (i, tuple(sorted((*first, other)))), (k, _without(second, other))


def _takes(roster: Roster, matrix: BoolArray, robot: int, target: int) -> bool:
    return not (roster.forbidden[robot, target] or matrix[robot, target])


def _without(row: tuple[int, ...], target: int) -> tuple[int, ...]:
    return tuple(j for j in row if j != target)
