"""Who may track what: capacities, failures, frozen rows and pins, as matrices.

Read off a snapshot once, so that the solvers of `solver.assignment` need to know nothing of
links and pins. A lost robot has no capacity; a jammed one keeps its row and cannot be told
anything; one in sensing failure may hold targets but does not see them (paper, eq. 4).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from solver.arrays import BoolArray, FloatArray, IntArray
from solver.directives import Pairing, Pin
from solver.observations import Link
from solver.snapshot import Snapshot, TrackStatus

UNCOVERED = 1e6
"""Price of a target that nobody has, m^2 of accumulated trace."""

UNSIGHTED = 1e4
"""Price of a target that nobody has who sees, likewise."""

_NEVER = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class Roster:
    """M robots, N targets that count (dropped ones do not). Matrices are (M, N)."""

    robot_ids: tuple[int, ...]
    target_ids: tuple[int, ...]
    target_rows: IntArray
    """(N,) rows of the targets in the snapshot's track table."""

    placed: BoolArray
    """(N,) whether it is known where the target is."""

    free: BoolArray
    """(M,) robots that can be told something: neither jammed nor lost."""

    seeing: BoolArray
    """(M,) robots that cover what they hold: neither lost nor in sensing failure."""

    capacity: IntArray
    """(M,) effective."""

    current: BoolArray
    """The assignment in force, without lost robots."""

    fixed: BoolArray
    """Pairs that must be: frozen rows and standing pins."""

    forbidden: BoolArray

    @property
    def spare(self) -> IntArray:
        """Return (M,) how many targets may be added to the fixed ones; 0 if not free."""
        room = np.maximum(self.capacity - self.fixed.sum(axis=1), 0)
        return np.where(self.free, room, 0)

    def pairs(self, matrix: BoolArray) -> frozenset[Pairing]:
        """Return an assignment matrix as pairs of ids."""
        return frozenset(
            Pairing(self.robot_ids[i], self.target_ids[j]) for i, j in np.argwhere(matrix).tolist()
        )


def roster_of(snapshot: Snapshot) -> Roster:
    """Return the roster at a snapshot."""
    robots, tracks, directives = snapshot.robots, snapshot.tracks, snapshot.directives
    status = tracks.status
    rows = np.array([r for r, s in enumerate(status) if s is not TrackStatus.DROPPED], dtype=int)
    targets = tuple(tracks.ids[r] for r in rows)
    robot_at = {robot_id: i for i, robot_id in enumerate(robots.ids)}
    target_at = {target_id: j for j, target_id in enumerate(targets)}
    lost = np.array([link is Link.LOST for link in robots.links], dtype=np.bool_)
    jammed = np.array([link is Link.JAMMED for link in robots.links], dtype=np.bool_)
    current = np.zeros((len(robots.ids), len(targets)), dtype=np.bool_)
    for pair in directives.assignment:
        if pair.robot_id in robot_at and pair.target_id in target_at:
            current[robot_at[pair.robot_id], target_at[pair.target_id]] = True
    current &= ~lost[:, None]
    fixed = current & jammed[:, None]
    asked = dict(directives.capacities)
    capacity = np.array([asked.get(robot_id, 0) for robot_id in robots.ids], dtype=np.int64)
    capacity = np.where(lost, 0, np.clip(capacity, 0, len(targets)))
    known = (TrackStatus.TRACKED, TrackStatus.COASTING)
    roster = Roster(
        robot_ids=robots.ids,
        target_ids=targets,
        target_rows=rows,
        placed=np.array([status[r] in known for r in rows], dtype=np.bool_),
        free=~(lost | jammed),
        seeing=~(lost | robots.sensing_failed),
        capacity=np.where(jammed, fixed.sum(axis=1), capacity),
        current=current,
        fixed=fixed,
        forbidden=np.zeros_like(current),
    )
    _pin(roster, snapshot, robot_at, target_at)
    return roster


def least_price_cover(roster: Roster, prices: FloatArray, displacing: FloatArray) -> BoolArray:
    """Return the fixed pairs and the cheapest others that cover as many targets as can be.

    Linear assignment on copies of the robots, one per place. Covering comes before being
    covered by a robot that sees, and that before the prices.

    Args:
        roster: Who may track what.
        prices: (M, N) of pairs, small against `UNSIGHTED`.
        displacing: (M, N) added where a pair takes the place of a current one.
    """
    result = roster.fixed.copy()
    seen = (roster.fixed & roster.seeing[:, None]).any(axis=0)
    open_targets = np.flatnonzero(~seen)
    spare = roster.spare
    copies = np.repeat(np.arange(len(spare)), spare)
    if not len(open_targets) or not len(copies):
        return result
    place = np.arange(len(copies)) - np.repeat(np.cumsum(spare) - spare, spare)
    taken = (roster.current & ~roster.fixed).sum(axis=1)
    blind = np.where(roster.seeing, 0.0, UNSIGHTED)
    costs = prices + blind[:, None]
    costs = np.where(roster.forbidden | roster.fixed, _NEVER, costs)[:, open_targets]
    table = costs[copies]
    occupied = place < taken[copies]
    table[occupied] += displacing[:, open_targets][copies[occupied]]
    left = np.where(roster.fixed.any(axis=0), UNSIGHTED, UNCOVERED)[open_targets]
    nobody = np.repeat(left[None], len(open_targets), axis=0)
    rows, columns = linear_sum_assignment(np.concatenate((table, nobody)))
    real = rows < len(copies)
    chosen = table[rows[real], columns[real]] < _NEVER
    result[copies[rows[real][chosen]], open_targets[columns[real][chosen]]] = True
    return result


def cover(roster: Roster, matrix: BoolArray) -> tuple[int, int]:
    """Return how many targets some robot holds, and how many some robot holds that sees."""
    seen = (matrix & roster.seeing[:, None]).any(axis=0)
    return int(matrix.any(axis=0).sum()), int(seen.sum())


def _pin(
    roster: Roster, snapshot: Snapshot, robot_at: dict[int, int], target_at: dict[int, int]
) -> None:
    """Enter the pins that stand.

    An operator's pin stands while its robot can be told and has room. A pin from a comment
    also gives way where it would cost a target its cover. Newer ones come first.
    """
    live = [pin for pin in snapshot.directives.pins if _is_live(pin, snapshot, roster, target_at)]
    operators = [pin for pin in reversed(live) if pin.comment_id is None]
    comments = [pin for pin in reversed(live) if pin.comment_id is not None]
    for pin in operators:
        _enter(roster, robot_at[pin.pair.robot_id], target_at[pin.pair.target_id], pin)
    if comments:
        places = [
            (robot_at[pin.pair.robot_id], target_at[pin.pair.target_id], pin) for pin in comments
        ]
        _enter_while_covered(roster, places, _best_cover(roster))


def _best_cover(roster: Roster) -> tuple[int, int]:
    free_of_charge = np.zeros(roster.current.shape)
    return cover(roster, least_price_cover(roster, free_of_charge, free_of_charge))


def _enter_while_covered(
    roster: Roster, pins: list[tuple[int, int, Pin]], whole: tuple[int, int]
) -> None:
    """Enter pins in order, each unless it would make the best cover less than `whole`.

    Pins only ever take cover away, so where all of them leave it whole each one does: many are
    tried at once and halved where that fails, which costs few matchings instead of one each.
    """
    entered = [
        (roster.forbidden if pin.forbids else roster.fixed, i, j)
        for i, j, pin in pins
        if not (roster.forbidden if pin.forbids else roster.fixed)[i, j]
        and _enter(roster, i, j, pin)
    ]
    if not entered or _best_cover(roster) == whole:
        return
    for table, i, j in entered:
        table[i, j] = False
    if len(pins) > 1:
        middle = len(pins) // 2
        _enter_while_covered(roster, pins[:middle], whole)
        _enter_while_covered(roster, pins[middle:], whole)


def _is_live(pin: Pin, snapshot: Snapshot, roster: Roster, target_at: dict[int, int]) -> bool:
    if pin.expires_s is not None and pin.expires_s <= snapshot.time_s:
        return False
    if pin.pair.target_id not in target_at or pin.pair.robot_id not in roster.robot_ids:
        return False
    return bool(roster.free[roster.robot_ids.index(pin.pair.robot_id)])


def _enter(roster: Roster, i: int, j: int, pin: Pin) -> bool:
    """Fix or forbid a pair unless an earlier one says otherwise or there is no room."""
    if pin.forbids:
        if not roster.fixed[i, j]:
            roster.forbidden[i, j] = True
            return True
    elif not roster.forbidden[i, j] and roster.spare[i] > 0:
        roster.fixed[i, j] = True
        return True
    return False
