"""Our own assignment of targets to robots: the fallback, and the baseline of the models.

Maximum expected information: the rows of A are chosen so that the accumulated predicted trace
is least (`solver.prospects`), coverage first, capacities, failures, pins and known zones
respected, and a price on every new pair. A robot shared by two targets far apart is worth little
to both, so rows are priced as sets: the sum of single gains would be 15 to 60 % worse.

Very small teams: the best of all assignments. Small teams: the best columns (robot, set) by
mixed-integer programming (HiGHS), then surplus capacity by local search. Large teams: linear
assignment on capacity copies, then a swap search, then second robots where there is room.
"""

from math import prod

import numpy as np

from solver.appraisal import Appraisal
from solver.arrays import BoolArray
from solver.columns import all_matrices, best_columns, columns_of, count_columns
from solver.directives import Pairing
from solver.problem import SensorModel
from solver.prospects import AssignmentSettings, Prospects
from solver.roster import Roster, least_price_cover, roster_of
from solver.snapshot import Snapshot
from solver.surplus import topped_up
from solver.swaps import improved, swapped

__all__ = ["AssignmentSettings", "assign", "repair"]

_OVERLAPS = (1.0, 0.5, 0.0)
"""Where capacity is to spare, different choices of columns to search on from."""

_SEARCHABLE = 200
"""Entries of A up to which every single change and exchange is tried in full at the end."""

_CHANGE = 10.0
_DISPLACE = 5.0
"""Prices of a new pair, and of taking a current one's place for it."""


def assign(
    snapshot: Snapshot, sensor: SensorModel, settings: AssignmentSettings
) -> frozenset[Pairing]:
    """Return the assignment of least predicted trace. Rows of jammed robots stay."""
    roster = roster_of(snapshot)
    if not roster.target_ids or not roster.spare.any():
        return roster.pairs(roster.fixed)
    prospects = Prospects(snapshot, roster, sensor, settings)
    if count_columns(roster) <= settings.most_columns:
        columns = columns_of(roster)
        if prod(len(sets) for sets in columns) <= settings.most_matrices:
            matrices = all_matrices(roster, columns)
            prices = Appraisal(roster, prospects, settings).prices(matrices)
            return roster.pairs(matrices[int(np.argmin(prices))])
        starts = [best_columns(roster, prospects, settings, overlap) for overlap in _OVERLAPS]
        return roster.pairs(improved(roster, prospects, settings, starts))
    robots, targets = np.indices(roster.current.shape).reshape(2, -1)
    single, _ = prospects.row(robots, targets[:, None])
    prices = single.reshape(roster.current.shape) - prospects.unseen
    prices = prices + settings.switching_cost * ~roster.current
    matrix = least_price_cover(roster, prices, np.zeros_like(prices))
    matrix = swapped(roster, prospects, settings, matrix)
    matrix = topped_up(roster, prospects, settings, matrix)
    if matrix.size <= _SEARCHABLE:
        matrix = improved(roster, prospects, settings, [matrix])
    return roster.pairs(matrix)


def repair(snapshot: Snapshot) -> frozenset[Pairing]:
    """Return the assignment in force with the fewest changes that cover what can be covered.

    For the moment a robot or a target is lost, long before a better assignment is found.
    Pairs of lost robots and dropped targets go; targets left alone (or left with robots that
    do not see, where others could) go to the nearest robot with room, or to one that can hand
    on a target; everything else stays.
    """
    roster = roster_of(snapshot)
    offset = (
        snapshot.tracks.positions[roster.target_rows][None] - (snapshot.robots.positions[:, None])
    )
    distance = np.hypot(offset[..., 0], offset[..., 1])
    # Below 1 and growing with distance: nearness decides only between equal changes.
    near = distance / (1.0 + distance) / max(1, len(roster.target_ids))
    prices = np.where(roster.current, 0.0, _CHANGE + near)
    displacing = np.where(roster.current, 0.0, _DISPLACE)
    return roster.pairs(_with_rest(roster, least_price_cover(roster, prices, displacing)))


def _with_rest(roster: Roster, matrix: BoolArray) -> BoolArray:
    """Return the matrix with those current pairs that there is still room for."""
    result = matrix.copy()
    room = np.where(roster.free, roster.capacity - matrix.sum(axis=1), 0)
    for i, j in np.argwhere(roster.current & ~matrix & ~roster.forbidden).tolist():
        if room[i] > 0:
            result[i, j] = True
            room[i] -= 1
    return result
