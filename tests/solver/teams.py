"""Small teams in trouble, as rosters with what their rows promise, for tests of the search."""

from itertools import combinations

import numpy as np

from solver.appraisal import Appraisal
from solver.arrays import BoolArray
from solver.observations import Link
from solver.problem import SensorModel
from solver.prospects import AssignmentSettings, Prospects
from solver.roster import Roster, roster_of
from tests.solver.snapshots import blinded, directed, pin, random_snapshot, with_links

SETTINGS = AssignmentSettings()
TROUBLES = ("none", "lost", "jammed", "blind", "pinned", "all")


def team(
    seed: int, robots: int, targets: int, capacity: int, trouble: str = "none"
) -> tuple[Roster, Prospects, Appraisal]:
    """Return a team of robots 21, 22, ... and targets 122, 123, ... and what it is worth."""
    snapshot = random_snapshot(seed, robots, targets, capacity, room=3.0)
    if trouble in ("lost", "all"):
        snapshot = with_links(snapshot, r21=Link.LOST)
    if trouble in ("jammed", "all"):
        snapshot = with_links(snapshot, r22=Link.JAMMED)
    if trouble in ("blind", "all"):
        snapshot = blinded(snapshot, 23)
    if trouble in ("pinned", "all"):
        pins = (pin(23, 122), pin(24, 123, "q", forbids=True), pin(24, 124, "r"))
        snapshot = directed(snapshot, pins=pins)
    roster = roster_of(snapshot)
    prospects = Prospects(snapshot, roster, SensorModel(), SETTINGS)
    return roster, prospects, Appraisal(roster, prospects, SETTINGS)


def allowed(roster: Roster, matrix: BoolArray) -> bool:
    """Return whether a matrix keeps to capacities, pins, and the rows of who cannot be told."""
    told = roster.free[:, None]
    return bool(
        (matrix.sum(axis=1) <= np.maximum(roster.capacity, roster.fixed.sum(axis=1))).all()
        and (matrix >= roster.fixed).all()
        and not (matrix & roster.forbidden).any()
        and np.array_equal(matrix & ~told, roster.fixed & ~told)
    )


def sets_of(roster: Roster, robot: int) -> list[tuple[int, ...]]:
    """Return every set of targets that a robot may hold, the hard way."""
    count = len(roster.target_ids)
    found = []
    for size in range(count + 1):
        for chosen in combinations(range(count), size):
            matrix = roster.fixed.copy()
            matrix[robot] = False
            matrix[robot, list(chosen)] = True
            if allowed(roster, matrix):
                found.append(chosen)
    return found
