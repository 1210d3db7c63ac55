"""Finding assignments: repair first, then small steps downhill, then only clear gains."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from llm.mock.reading import Reading, SeenRobot
from llm.mock.scoring import Board, Cost, Plan, Scorer

CLEAR_GAIN = 0.05
"""Relative gain in the summed trace below which nothing is reassigned."""

NEAREST = 4
"""Robots tried per target."""

MOST_STEPS = 6000
"""Changes priced per answer, so that a large team's answer is never late."""

NO_GAIN = -1e-9

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
    """Return the plan, or the nearest thing to it that covers what can be covered."""
    board = Board(Scorer(reading, one_each=False), _kept_to(reading, plan, bounds))
    _descend(reading, board, bounds, wanted=lambda gain: duties(gain) < (0, 0, 0))
    return board.plan


def improved(reading: Reading, plan: Plan, bounds: Bounds) -> Plan:
    """Return a clearly better plan, or the plan itself."""
    board = Board(Scorer(reading, bounds.one_each), plan)
    start = board.cost
    _descend(reading, board, bounds, wanted=lambda gain: gain < _NOTHING)
    cost = board.cost
    needed = replace(cost, trace=0.0) < replace(start, trace=0.0)
    return board.plan if needed or cost.trace < (1.0 - CLEAR_GAIN) * start.trace else plan


_NOTHING = Cost(0, 0, 0, 0, NO_GAIN)


def _descend(
    reading: Reading, board: Board, bounds: Bounds, wanted: Callable[[Cost], bool]
) -> None:
    """Take, target by target, the best wanted change there is, until there is none."""
    steps = MOST_STEPS
    moved = True
    while moved and steps > 0:
        moved = False
        for target in reading.targets:
            changes = [c for c in _changes(reading, board.plan, target.id) if bounds.allow(c)]
            priced = [(board.gain(change), index) for index, change in enumerate(changes)]
            steps -= len(priced)
            best = min(priced, default=None)
            if best is not None and wanted(best[0]):
                board.apply(changes[best[1]])
                moved = True
            if steps <= 0:
                break


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
    place = next((t.position for t in reading.targets if t.id == target_id), None)
    if place is None:
        return free[:NEAREST]
    return sorted(
        free,
        key=lambda robot: (
            (robot.position[0] - place[0]) ** 2 + (robot.position[1] - place[1]) ** 2,
            robot.id,
        ),
    )[:NEAREST]
