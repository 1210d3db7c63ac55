"""How well an assignment covers the targets, and how well it could (paper, eq. 4).

The least number of targets that must stay without a robot is computed, not assumed: from
effective capacities, frozen rows and the pins in force.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import maximum_flow

from solver.directives import Pairing, Pin
from solver.observations import Link
from solver.snapshot import Snapshot, TrackStatus


@dataclass(frozen=True, slots=True)
class Team:
    """Who can track whom at a snapshot."""

    links: Mapping[int, Link]
    """Per robot id, in team order."""

    blind: frozenset[int]
    """Robots in sensing failure."""

    targets: tuple[int, ...]
    """Ids of the targets that count, in mission order; dropped ones do not."""

    dropped: frozenset[int]
    capacities: Mapping[int, int]
    """Effective, per robot id: 0 for a lost robot, the length of a jammed one's row."""

    frozen: Mapping[int, frozenset[int]]
    """Rows of the jammed robots."""

    @classmethod
    def of(cls, snapshot: Snapshot, capacities: Mapping[int, int] | None = None) -> Self:
        """Read the team from a snapshot; capacities default to the directives'."""
        robots, tracks = snapshot.robots, snapshot.tracks
        links = dict(zip(robots.ids, robots.links, strict=True))
        live = tuple(
            target_id
            for target_id, status in zip(tracks.ids, tracks.status, strict=True)
            if status is not TrackStatus.DROPPED
        )
        frozen = {
            robot_id: frozenset(snapshot.directives.targets_of(robot_id)).intersection(live)
            for robot_id, link in links.items()
            if link is Link.JAMMED
        }
        asked = dict(snapshot.directives.capacities) if capacities is None else capacities
        effective = {}
        for robot_id, link in links.items():
            if link is Link.LOST:
                effective[robot_id] = 0
            elif robot_id in frozen:
                effective[robot_id] = len(frozen[robot_id])
            else:
                effective[robot_id] = min(max(asked.get(robot_id, 0), 0), len(live))
        return cls(
            links=links,
            blind=frozenset(
                robot_id
                for robot_id, failed in zip(robots.ids, robots.sensing_failed, strict=True)
                if failed
            ),
            targets=live,
            dropped=frozenset(tracks.ids).difference(live),
            capacities=effective,
            frozen=frozen,
        )

    def sighted(self) -> frozenset[int]:
        """Return the robots that see: neither lost nor in sensing failure."""
        return frozenset(
            robot_id
            for robot_id, link in self.links.items()
            if link is not Link.LOST and robot_id not in self.blind
        )


@dataclass(frozen=True, slots=True)
class Shortfall:
    """What an assignment lacks."""

    overloaded: tuple[tuple[int, int], ...]
    """(robot id, number of its targets) for rows above effective capacity."""

    overload: int
    uncovered: tuple[int, ...]
    """Targets tracked by no robot."""

    allowed_uncovered: int
    """As many at least, whatever the assignment."""

    unsighted: tuple[int, ...]
    """Targets tracked by no robot that sees."""

    allowed_unsighted: int

    @property
    def excess_uncovered(self) -> int:
        """Return how many targets too many have no robot."""
        return max(0, len(self.uncovered) - self.allowed_uncovered)

    @property
    def excess_unsighted(self) -> int:
        """Return how many targets too many have no robot that sees."""
        return max(0, len(self.unsighted) - self.allowed_unsighted)

    @property
    def beta(self) -> int:
        """Return beta(A); 0 when the assignment may be used."""
        return self.overload + max(self.excess_uncovered, self.excess_unsighted)


def shortfall(assignment: Iterable[Pairing], team: Team, pins: Iterable[Pin] = ()) -> Shortfall:
    """Compare an assignment with the best that capacities, failures and pins allow.

    Args:
        assignment: The ones of A; unknown robots and targets do not count.
        team: The team at the snapshot of arrival.
        pins: Those that stand (`standing_pins`).
    """
    rows: dict[int, set[int]] = {robot_id: set() for robot_id in team.links}
    live = set(team.targets)
    for robot_id, target_id in assignment:
        if robot_id in rows and target_id in live:
            rows[robot_id].add(target_id)
    overloaded = tuple(
        (robot_id, len(row))
        for robot_id, row in rows.items()
        if len(row) > team.capacities[robot_id] and robot_id not in team.frozen
    )
    fixed, forbidden = _fixed(team, pins)
    sighted = team.sighted()
    able = frozenset(r for r, link in team.links.items() if link is not Link.LOST)
    covered = set[int]().union(*(rows[r] for r in able))
    seen = set[int]().union(*(rows[r] for r in sighted))
    return Shortfall(
        overloaded=overloaded,
        overload=sum(given - team.capacities[robot_id] for robot_id, given in overloaded),
        uncovered=tuple(t for t in team.targets if t not in covered),
        allowed_uncovered=len(team.targets) - _reachable(team, able, fixed, forbidden),
        unsighted=tuple(t for t in team.targets if t not in seen),
        allowed_unsighted=len(team.targets) - _reachable(team, sighted, fixed, forbidden),
    )


def standing_pins(snapshot: Snapshot, team: Team) -> tuple[Pin, ...]:
    """Return the pins that bind an answer now.

    A pin is void when it has expired, when its robot is lost or jammed (its row is frozen)
    or its target dropped. An operator's pin otherwise stands as long as the robot has room.
    A pin from a comment gives way, older before newer, where it contradicts another or
    would cost a target its cover.
    """
    hard: list[Pin] = []
    soft: list[Pin] = []
    for pin in snapshot.directives.pins:
        if _void(pin, team, snapshot.time_s):
            continue
        (hard if pin.comment_id is None else soft).append(pin)
    standing: list[Pin] = []
    for pin in reversed(hard):
        if _fits(pin, standing, team):
            standing.append(pin)
    best = _best_cover(team, standing)
    for pin in reversed(soft):
        if _fits(pin, standing, team) and _best_cover(team, [*standing, pin]) == best:
            standing.append(pin)
    kept = {pin.id for pin in standing}
    return tuple(pin for pin in snapshot.directives.pins if pin.id in kept)


def _void(pin: Pin, team: Team, time_s: float) -> bool:
    expired = pin.expires_s is not None and pin.expires_s <= time_s
    reachable = team.links.get(pin.pair.robot_id) is Link.CONNECTED
    return expired or not reachable or pin.pair.target_id not in team.targets


def _fits(pin: Pin, standing: list[Pin], team: Team) -> bool:
    same_robot = [p for p in standing if p.pair.robot_id == pin.pair.robot_id]
    if any(p.pair == pin.pair and p.forbids is not pin.forbids for p in same_robot):
        return False
    held = {p.pair.target_id for p in same_robot if not p.forbids}
    return pin.forbids or len(held | {pin.pair.target_id}) <= team.capacities[pin.pair.robot_id]


def _best_cover(team: Team, pins: Iterable[Pin]) -> tuple[int, int]:
    fixed, forbidden = _fixed(team, pins)
    able = frozenset(r for r, link in team.links.items() if link is not Link.LOST)
    return (
        _reachable(team, able, fixed, forbidden),
        _reachable(team, team.sighted(), fixed, forbidden),
    )


def _fixed(team: Team, pins: Iterable[Pin]) -> tuple[dict[int, set[int]], set[Pairing]]:
    """Return the targets each robot must have, and the pairs that must not be."""
    fixed = {robot_id: set(team.frozen.get(robot_id, ())) for robot_id in team.links}
    forbidden = set()
    for pin in pins:
        if pin.forbids:
            forbidden.add(pin.pair)
        else:
            fixed[pin.pair.robot_id].add(pin.pair.target_id)
    return fixed, forbidden


def _reachable(
    team: Team, robots: frozenset[int], fixed: dict[int, set[int]], forbidden: set[Pairing]
) -> int:
    """Return how many targets these robots can cover at most."""
    held = set[int]().union(*(fixed[robot_id] for robot_id in robots))
    rest = [target_id for target_id in team.targets if target_id not in held]
    spare = {
        robot_id: max(0, team.capacities[robot_id] - len(fixed[robot_id])) for robot_id in robots
    }
    if not any(pair.robot_id in robots for pair in forbidden):
        return len(held) + min(len(rest), sum(spare.values()))
    return len(held) + _largest_matching(spare, rest, forbidden)


def _largest_matching(spare: dict[int, int], rest: list[int], forbidden: set[Pairing]) -> int:
    """Return the most targets that robots with spare places can take, by maximum flow."""
    robots = sorted(spare)
    source, sink = 0, 1 + len(robots) + len(rest)
    edges = [(source, 1 + i, spare[robot_id]) for i, robot_id in enumerate(robots)]
    edges += [(1 + len(robots) + j, sink, 1) for j in range(len(rest))]
    edges += [
        (1 + i, 1 + len(robots) + j, 1)
        for i, robot_id in enumerate(robots)
        for j, target_id in enumerate(rest)
        if Pairing(robot_id, target_id) not in forbidden
    ]
    rows, columns, values = np.array(edges, dtype=np.int32).T
    graph = coo_array((values, (rows, columns)), shape=(sink + 1, sink + 1)).tocsr()
    return int(maximum_flow(graph, source, sink).flow_value)
