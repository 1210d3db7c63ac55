"""How good an assignment is by the mock's rule of thumb.

Each robot is imagined a few seconds on, near the middle of its targets but outside the
keep-outs it was told of; each target then has the covariance that the robots tracking it
leave: range and bearing with noise growing with distance, so distance, zones and the angle
between two lines of sight all count.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from llm.mock.reading import Point, Reading, SeenRobot, SeenZone

Plan = Mapping[int, frozenset[int]]
"""Robot id -> target ids."""

LOOK_AHEAD_S = 5.0
REACH_M = 2.5
"""How far a robot is imagined to get."""

PRIOR_VARIANCE = 0.5
PEAK, SHAPE = 15.0, 0.2
NEAREST_M = 0.5
DETOUR_COST = 0.1
"""For a line of sight or way that crosses a keep-out."""

TRAVEL_COST = 0.03
"""Per metre between a robot and the middle of its targets."""


Part = tuple[int, int, int, int, float]
"""A summand of a cost, field by field."""


@dataclass(frozen=True, slots=True, order=True)
class Cost:
    """Compared part by part, first things first."""

    overload: int
    uncovered: int
    unsighted: int
    doubled: int
    """Targets with more than one robot, where one each was asked for."""

    trace: float


@dataclass(eq=False)
class Scorer:
    """Scores plans of one situation; remembers what it has worked out."""

    reading: Reading
    one_each: bool
    _robots: dict[int, SeenRobot] = field(init=False)
    _places: dict[int, Point | None] = field(init=False)
    _stands: dict[tuple[int, frozenset[int]], Point] = field(default_factory=dict, init=False)
    _crossings: dict[tuple[int, int], bool] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        """Index the reading."""
        self._robots = {robot.id: robot for robot in self.reading.robots}
        self._places = {}
        for target in self.reading.targets:
            place = target.position
            self._places[target.id] = place and (
                place[0] + LOOK_AHEAD_S * target.velocity[0],
                place[1] + LOOK_AHEAD_S * target.velocity[1],
            )

    def cost(self, plan: Plan) -> Cost:
        """Return the cost of a plan; less is better."""
        return Board(self, plan).cost

    def robot_part(self, robot_id: int, row: frozenset[int]) -> Part:
        """Return what a robot's row adds to the cost, its targets' traces apart."""
        robot = self._robots[robot_id]
        overload = max(0, len(row) - robot.capacity) if robot.free else 0
        return (overload, 0, 0, 0, self._travel(robot_id, row))

    def target_part(self, target_id: int, watchers: frozenset[int], plan: Plan) -> Part:
        """Return what a target adds to the cost, given the robots that track it."""
        seeing = sorted(r for r in watchers if not self._robots[r].blind)
        doubled = max(0, len(watchers) - 1) * self.one_each
        trace = self._trace(target_id, seeing, plan)
        return (0, int(not watchers), int(not seeing), doubled, trace)

    def _travel(self, robot_id: int, row: frozenset[int]) -> float:
        middle = self._middle(row)
        if middle is None:
            return 0.0
        crossed = sum(self._crosses(robot_id, target_id) for target_id in row)
        away_m = math.dist(self._robots[robot_id].position, middle)
        return TRAVEL_COST * away_m + DETOUR_COST * crossed

    def _trace(self, target_id: int, robot_ids: list[int], plan: Plan) -> float:
        """Return tr (P^-1 + sum H'R^-1H)^-1 of one target (paper, section III-B)."""
        place = self._places[target_id]
        xx = yy = 1.0 / PRIOR_VARIANCE
        xy = 0.0
        if place is not None:
            for robot_id in robot_ids:
                stand = self._stand(robot_id, plan[robot_id])
                dx, dy = place[0] - stand[0], place[1] - stand[1]
                away = math.hypot(dx, dy)
                # On top of the target the line of sight is any; information is finite.
                dx, dy = (dx / away, dy / away) if away > 1e-6 else (1.0, 0.0)
                away = max(NEAREST_M, away)
                along = PEAK * math.exp(-SHAPE * away)
                across = along / away**2
                xx += along * dx * dx + across * dy * dy
                yy += along * dy * dy + across * dx * dx
                xy += (along - across) * dx * dy
        return (xx + yy) / (xx * yy - xy * xy)

    def _middle(self, row: frozenset[int]) -> Point | None:
        places = [place for t in sorted(row) if (place := self._places.get(t)) is not None]
        if not places:
            return None
        return (
            sum(place[0] for place in places) / len(places),
            sum(place[1] for place in places) / len(places),
        )

    def _stand(self, robot_id: int, row: frozenset[int]) -> Point:
        """Return where a robot would stand for its targets."""
        key = (robot_id, row)
        if key not in self._stands:
            start = self._robots[robot_id].position
            middle = self._middle(row) or start
            away = math.dist(start, middle)
            part = 0.0 if away < 1e-9 else min(1.0, REACH_M / away)
            place = (
                start[0] + part * (middle[0] - start[0]),
                start[1] + part * (middle[1] - start[1]),
            )
            for zone in self.reading.zones:
                place = _outside(place, start, zone)
            self._stands[key] = place
        return self._stands[key]

    def _crosses(self, robot_id: int, target_id: int) -> bool:
        key = (robot_id, target_id)
        if key not in self._crossings:
            place = self._places.get(target_id)
            start = self._robots[robot_id].position
            self._crossings[key] = place is not None and any(
                _segment_distance(zone.position, start, place) < zone.keep_out_m
                for zone in self.reading.zones
            )
        return self._crossings[key]


def _total(parts: Iterable[Part]) -> Cost:
    overload = uncovered = unsighted = doubled = 0
    trace = 0.0
    for part in parts:
        overload += part[0]
        uncovered += part[1]
        unsighted += part[2]
        doubled += part[3]
        trace += part[4]
    return Cost(overload, uncovered, unsighted, doubled, trace)


class Board:
    """A plan with its cost kept piece by piece, so that a small change is cheap to price."""

    def __init__(self, scorer: Scorer, plan: Plan) -> None:
        self.scorer = scorer
        self.plan = dict(plan)
        known = [target.id for target in scorer.reading.targets]
        self._watchers = {
            t: frozenset(r for r, row in self.plan.items() if t in row) for t in known
        }
        self._robots = {r: scorer.robot_part(r, row) for r, row in self.plan.items()}
        self._targets = {t: scorer.target_part(t, self._watchers[t], self.plan) for t in known}

    @property
    def cost(self) -> Cost:
        """Return the cost of the plan."""
        return _total((*self._robots.values(), *self._targets.values()))

    def gain(self, change: Plan) -> Cost:
        """Return by how much a change of rows would alter the cost; negative is better."""
        after = {**self.plan, **change}
        before: list[Part] = []
        then: list[Part] = []
        for robot_id, row in change.items():
            before.append(self._robots[robot_id])
            then.append(self.scorer.robot_part(robot_id, row))
        for target_id in self._touched(change):
            before.append(self._targets[target_id])
            watchers = self._watched(target_id, change)
            then.append(self.scorer.target_part(target_id, watchers, after))
        was, will = _total(before), _total(then)
        return Cost(
            will.overload - was.overload,
            will.uncovered - was.uncovered,
            will.unsighted - was.unsighted,
            will.doubled - was.doubled,
            will.trace - was.trace,
        )

    def apply(self, change: Plan) -> None:
        """Change rows."""
        touched = self._touched(change)
        watchers = {t: self._watched(t, change) for t in touched}
        self.plan.update(change)
        self._watchers.update(watchers)
        for robot_id, row in change.items():
            self._robots[robot_id] = self.scorer.robot_part(robot_id, row)
        for target_id in touched:
            self._targets[target_id] = self.scorer.target_part(
                target_id, self._watchers[target_id], self.plan
            )

    def _touched(self, change: Plan) -> list[int]:
        targets = {t for r, row in change.items() for t in row | self.plan[r]}
        return sorted(targets & self._watchers.keys())

    def _watched(self, target_id: int, change: Plan) -> frozenset[int]:
        watchers = self._watchers[target_id]
        gone = {r for r, row in change.items() if target_id not in row}
        come = {r for r, row in change.items() if target_id in row}
        return frozenset((watchers - gone) | come)


def _outside(place: Point, start: Point, zone: SeenZone) -> Point:
    """Move a place inside a keep-out to its rim, on the side the robot comes from."""
    if math.dist(place, zone.position) >= zone.keep_out_m:
        return place
    dx, dy = start[0] - zone.position[0], start[1] - zone.position[1]
    away = math.hypot(dx, dy)
    if away < 1e-9:
        return (zone.position[0] + zone.keep_out_m, zone.position[1])
    part = zone.keep_out_m / away
    return (zone.position[0] + part * dx, zone.position[1] + part * dy)


def _segment_distance(point: Point, start: Point, end: Point) -> float:
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = dx * dx + dy * dy
    part = 0.0
    if length > 0.0:
        part = ((point[0] - start[0]) * dx + (point[1] - start[1]) * dy) / length
        part = min(1.0, max(0.0, part))
    return math.dist(point, (start[0] + part * dx, start[1] + part * dy))
