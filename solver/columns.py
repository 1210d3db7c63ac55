"""The exact choice of rows for small teams: one column per robot and set of targets."""

from itertools import combinations
from math import comb, prod

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array, hstack, vstack

from solver.appraisal import padded
from solver.arrays import BoolArray, FloatArray, IntArray
from solver.prospects import AssignmentSettings, Prospects
from solver.roster import UNCOVERED, UNSIGHTED, Roster, least_price_cover


def count_columns(roster: Roster) -> int:
    """Return how many columns there are to choose from, without making them."""
    total = 0
    for i, spare in enumerate(roster.spare.tolist()):
        others = int((~(roster.fixed[i] | roster.forbidden[i])).sum()) if roster.free[i] else 0
        total += sum(comb(others, size) for size in range(min(spare, others) + 1))
    return total


def columns_of(roster: Roster) -> list[list[tuple[int, ...]]]:
    """Return for each robot the sets of targets it may hold; its own alone if it is not free."""
    columns = []
    for i, spare in enumerate(roster.spare.tolist()):
        fixed = tuple(np.flatnonzero(roster.fixed[i]).tolist())
        others = np.flatnonzero(~(roster.fixed[i] | roster.forbidden[i])).tolist()
        columns.append(
            [
                tuple(sorted((*fixed, *chosen)))
                for size in range(min(spare, len(others)) + 1)
                for chosen in combinations(others, size)
            ]
        )
    return columns


def all_matrices(roster: Roster, columns: list[list[tuple[int, ...]]]) -> BoolArray:
    """Return every choice of one column per robot, (B, M, N); the last robot's changes fastest."""
    batch = prod(len(sets) for sets in columns)
    result = np.zeros((batch, len(columns), len(roster.target_ids)), dtype=np.bool_)
    # Counted digit by digit: numpy's own grids end at 64 axes, which are robots here.
    rest = np.arange(batch)
    for i in reversed(range(len(columns))):
        rows = np.zeros((len(columns[i]), len(roster.target_ids)), dtype=np.bool_)
        for at, targets in enumerate(columns[i]):
            rows[at, list(targets)] = True
        rest, digit = np.divmod(rest, len(rows))
        result[:, i] = rows[digit]
    return result


def best_columns(
    roster: Roster, prospects: Prospects, settings: AssignmentSettings, overlap: float
) -> BoolArray:
    """Return the rows of least summed price.

    Exact where every target is held once.

    Args:
        roster: Who may track what.
        prospects: What rows promise.
        settings: The price of changes.
        overlap: What is taken off for a second robot on a target, in units of the target's
            greatest gain: 1 counts no gain twice, less favours two robots on one target.
    """
    rows = [(i, targets) for i, sets in enumerate(columns_of(roster)) for targets in sets]
    robots, members = padded(rows)
    traces, _ = prospects.row(robots, members)
    real = members >= 0
    held = np.where(real, members, 0)
    gains = (prospects.unseen[held] - traces) * real
    # Who cannot be told, or does not see, informs nobody.
    gains *= (roster.seeing & roster.free)[robots][:, None]
    new = (real & ~roster.current[robots[:, None], held]).sum(axis=1)
    prices = settings.switching_cost * new - gains.sum(axis=1)
    chosen = _chosen(roster, robots, members, prices, overlap * gains)
    if chosen is None:
        return least_price_cover(roster, np.zeros(roster.fixed.shape), np.zeros(roster.fixed.shape))
    result = np.zeros_like(roster.fixed)
    for robot, targets in (rows[column] for column in chosen.tolist()):
        result[robot, list(targets)] = True
    return result


def _chosen(
    roster: Roster,
    robots: IntArray,
    members: IntArray,
    prices: FloatArray,
    gains: FloatArray,
) -> IntArray | None:
    """Return the columns HiGHS chooses, None if it finds nothing (it should not happen)."""
    count, targets = len(robots), len(roster.target_ids)
    column, place = np.nonzero(members >= 0)
    target = members[column, place]
    holds = coo_array((np.ones(len(column)), (target, column)), shape=(targets, count)).tocsr()
    sees = holds.multiply(roster.seeing[robots][None]).tocsr()
    one_each = coo_array((np.ones(count), (robots, np.arange(count))))
    best = np.zeros(targets)
    np.maximum.at(best, target, gains[column, place])
    unit, nothing = coo_array(np.eye(targets)), coo_array((targets, targets))
    rows = vstack(
        [
            hstack([one_each, coo_array((one_each.shape[0], 3 * targets))]),
            hstack([holds, unit, nothing, nothing]),
            hstack([sees, nothing, unit, nothing]),
            hstack([sees, nothing, nothing, -unit]),
        ]
    )
    team = one_each.shape[0]
    lower = np.concatenate((np.ones(team + 2 * targets), np.full(targets, -np.inf)))
    upper = np.concatenate((np.ones(team), np.full(2 * targets, np.inf), np.ones(targets)))
    costs = np.concatenate((prices, np.full(targets, UNCOVERED), np.full(targets, UNSIGHTED), best))
    whole = np.concatenate((np.ones(count), np.zeros(3 * targets)))
    answer = milp(
        costs,
        integrality=whole,
        bounds=Bounds(0.0, np.concatenate((np.ones(count), np.full(3 * targets, np.inf)))),
        constraints=LinearConstraint(rows.tocsr(), lower, upper),
        options={"mip_rel_gap": 0.0},
    )
    return None if answer.x is None else np.flatnonzero(answer.x[:count] > 0.5)
