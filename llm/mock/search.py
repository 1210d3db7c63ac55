"""Finding assignments: repair first, then small steps downhill, then only clear gains."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from llm.mock.reading import Reading, SeenRobot
from llm.mock.scoring import Board, Cost, Plan, Scorer

CLEAR_GAIN = 0.05
"""Relative gain in the summed trace below which nothing is reassigned."""

SMALL_GAIN = 0.005
"""The same while a person wants the targets tracked better: a change is worth its trouble."""

NEAREST = 4
"""Robots tried per target."""

MOST_STEPS = 6000
"""Changes priced per answer, so that a large team's answer is never late."""

MOST_EXCHANGED = 16
"""Robots tried for changing places wholly."""

NOTHING = Cost(0, 0, 0, 0, -1e-9)
"""A change that does not cost less than this is none."""

Pair = tuple[int, int]


@dataclass(slots=True)
class Bounds:
    """What an assignment must keep to, by pins and comments."""

    required: dict[Pair, str] = field(default_factory=dict)
    """Pair -> label of the comment that asked for it; empty for a pin."""

    forbidden: dict[Pair, str] = field(default_factory=dict)
    one_each: bool = False

    def allow(self, change: Plan) -> bool:
        """Return whether changed rows keep to the pairs."""
        return all(t in change[r] for r, t in self.required if r in change) and not any(
            t in change[r] for r, t in self.forbidden if r in change
        )

    def follow(self, plan: Plan) -> None:
        """Give up what older comments asked for where a newer one has overruled them."""
        for pair in [p for p, label in self.required.items() if label]:
            if pair[1] not in plan.get(pair[0], ()):
                del self.required[pair]
        for pair in [p for p, label in self.forbidden.items() if label]:
            if pair[1] in plan.get(pair[0], ()):
                del self.forbidden[pair]


def duties(cost: Cost) -> tuple[int, int, int]:
    """Return what must be right before anything may be good."""
    return cost.overload, cost.uncovered, cost.unsighted


def sound(reading: Reading, plan: Plan, bounds: Bounds) -> Plan:
    """Return the plan, or one near to it that covers what can be covered.

    Targets without a robot, then those without a robot that sees, are given one, along a
    chain of hand-overs where the robots near by are full.
    """
    rows = {robot_id: set(row) for robot_id, row in _kept_to(reading, plan, bounds).items()}
    takers = [robot for robot in reading.robots if robot.free and robot.id in rows]
    blind = {robot.id for robot in reading.robots if robot.blind}
    for able in (takers, [robot for robot in takers if not robot.blind]):
        for target in reading.targets:
            watched = any(
                target.id in row and (able is takers or robot_id not in blind)
                for robot_id, row in rows.items()
            )
            if not watched:
                _give(reading, rows, able, bounds, target.id)
    return {robot_id: frozenset(row) for robot_id, row in rows.items()}


def _give(
    reading: Reading,
    rows: dict[int, set[int]],
    able: list[SeenRobot],
    bounds: Bounds,
    target_id: int,
) -> bool:
    """Find a robot for a target, by an augmenting path; return whether there is one.

    The path is kept as a list: in a large team that is full it is longer than calls may be nested.
    """
    tried: set[int] = set()
    path: list[tuple[int, int, int]] = []
    """(robot, target it takes, target it gives up) of those that have not found a taker yet."""
    offers = [_offers(reading, rows, able, bounds, target_id, tried)]
    while offers:
        wanted = path[-1][2] if path else target_id
        robot_id, given_up = next(offers[-1], (None, None))
        if robot_id is None:
            offers.pop()
            if path:
                robot_id, _, kept = path.pop()
                rows[robot_id].add(kept)
            continue
        if given_up is not None:
            rows[robot_id].discard(given_up)
            if not any(given_up in rows[other.id] for other in able):
                path.append((robot_id, wanted, given_up))
                offers.append(_offers(reading, rows, able, bounds, given_up, tried))
                continue
        for taker, taken, _ in (*path, (robot_id, wanted, given_up)):
            rows[taker].add(taken)
        return True
    return False


def _offers(
    reading: Reading,
    rows: dict[int, set[int]],
    able: list[SeenRobot],
    bounds: Bounds,
    target_id: int,
    tried: set[int],
) -> Iterator[tuple[int, int | None]]:
    """Yield robots that could take a target, the nearest first, and what each would give up."""
    for robot in _by_distance(reading, able, target_id):
        if robot.id in tried or (robot.id, target_id) in bounds.forbidden:
            continue
        tried.add(robot.id)
        if len(rows[robot.id]) < robot.capacity:
            yield robot.id, None
        for given_up in sorted(rows[robot.id]):
            if (robot.id, given_up) not in bounds.required:
                yield robot.id, given_up


def improved(reading: Reading, plan: Plan, bounds: Bounds, least_gain: float = CLEAR_GAIN) -> Plan:
    """Return a plan whose summed trace is less by a share of `least_gain`, or the plan itself."""
    board = Board(Scorer(reading, bounds.one_each), plan)
    start = board.cost
    _descend(reading, board, bounds)
    cost = board.cost
    needed = replace(cost, trace=0.0) < replace(start, trace=0.0)
    return board.plan if needed or cost.trace < (1.0 - least_gain) * start.trace else plan


def _descend(reading: Reading, board: Board, bounds: Bounds) -> None:
    """Take, target by target, the best change that helps, until there is none."""
    steps = MOST_STEPS
    moved = True
    while moved and steps > 0:
        moved = False
        for target in reading.targets:
            changes = [c for c in _changes(reading, board.plan, target.id) if bounds.allow(c)]
            priced = [(board.gain(change), index) for index, change in enumerate(changes)]
            steps -= len(priced)
            best = min(priced, default=None)
            if best is not None and best[0] < NOTHING:
                board.apply(changes[best[1]])
                moved = True
            if steps <= 0:
                break
        moved = moved or _exchange(board, bounds, _pairs(reading, board.plan))


def _exchange(board: Board, bounds: Bounds, pairs: list[tuple[SeenRobot, SeenRobot]]) -> bool:
    """Let two robots change places wholly, where that helps; return whether any did."""
    for one, other in pairs:
        change = {one.id: board.plan[other.id], other.id: board.plan[one.id]}
        fits = len(change[one.id]) <= one.capacity and len(change[other.id]) <= other.capacity
        if fits and bounds.allow(change) and board.gain(change) < NOTHING:
            board.apply(change)
            return True
    return False


def _pairs(reading: Reading, plan: Plan) -> list[tuple[SeenRobot, SeenRobot]]:
    free = [robot for robot in reading.robots if robot.free and robot.id in plan]
    return list(itertools.combinations(free[:MOST_EXCHANGED], 2))


def _kept_to(reading: Reading, plan: Plan, bounds: Bounds) -> Plan:
    """Force the pairs and the capacities onto a plan; cover may be lost by it."""
    rows: dict[int, frozenset[int]] = {}
    for robot in reading.robots:
        if robot.lost:
            continue
        row = set(plan.get(robot.id, ()))
        if robot.free:
            must = {t for r, t in bounds.required if r == robot.id}
            row = (row | must) - {t for r, t in bounds.forbidden if r == robot.id}
            spare = sorted(row - must)
            while len(row) > robot.capacity and spare:
                row.discard(spare.pop())
        rows[robot.id] = frozenset(row)
    return rows


def _changes(reading: Reading, plan: Plan, target_id: int) -> Iterator[Plan]:
    """Yield changes about one target: add, drop, exchange, hand over, swap."""
    free = [robot for robot in reading.robots if robot.free and robot.id in plan]
    holders = [robot for robot in free if target_id in plan[robot.id]]
    for robot in _nearest(reading, free, target_id):
        if target_id not in plan[robot.id]:
            for row, given_up in _takings(plan[robot.id], robot, target_id):
                yield from _rehomed({robot.id: row}, plan, holders, target_id, given_up)
    for robot in holders:
        yield {robot.id: plan[robot.id] - {target_id}}


def _takings(
    row: frozenset[int], robot: SeenRobot, target_id: int
) -> Iterator[tuple[frozenset[int], int | None]]:
    """Yield the ways a robot can take a target: into a free place, or for another target."""
    if len(row) < robot.capacity:
        yield row | {target_id}, None
    for given_up in sorted(row):
        yield row - {given_up} | {target_id}, given_up


def _rehomed(
    taken: Plan, plan: Plan, holders: list[SeenRobot], target_id: int, given_up: int | None
) -> Iterator[Plan]:
    """Yield what becomes of a target that a robot takes: shared, handed over, or swapped."""
    yield taken
    for holder in holders:
        handed = plan[holder.id] - {target_id}
        yield {**taken, holder.id: handed}
        if given_up is not None and given_up not in handed:
            yield {**taken, holder.id: handed | {given_up}}


def _nearest(reading: Reading, free: list[SeenRobot], target_id: int) -> list[SeenRobot]:
    return _by_distance(reading, free, target_id)[:NEAREST]


def _by_distance(reading: Reading, robots: list[SeenRobot], target_id: int) -> list[SeenRobot]:
    place = next((t.position for t in reading.targets if t.id == target_id), None)
    if place is None:
        return robots
    return sorted(robots, key=lambda robot: (math.dist(robot.position, place), robot.id))
