"""The recent past as the models are told it (paper, section III-C: the last k results)."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Self

from solver.directives import Pairing, Weights
from solver.observations import Attack, Link
from solver.snapshot import Snapshot, TrackStatus
from solver.zones import Point

RESULTS = 5
"""k of the paper."""


@dataclass(frozen=True, slots=True)
class RobotThen:
    """One robot at one moment."""

    robot_id: int
    position: Point
    velocity: Point
    link: Link
    sensing_failed: bool


@dataclass(frozen=True, slots=True)
class TargetThen:
    """One target at one moment, as it was believed to be."""

    target_id: int
    position: Point
    velocity: Point


@dataclass(frozen=True, slots=True)
class HistoryEntry:
    """One result: states, what was suffered since the result before, who tracked whom."""

    time_s: float
    robots: tuple[RobotThen, ...]
    targets: tuple[TargetThen, ...]
    attacks: tuple[Attack, ...]
    assignment: frozenset[Pairing]
    weights: Weights
    trace: float

    @classmethod
    def of(cls, snapshot: Snapshot, attacks: Iterable[Attack] | None = None) -> Self:
        """Take an entry from a snapshot.

        Args:
            snapshot: The moment.
            attacks: Those since the entry before; the snapshot's own where None.
        """
        robots, tracks = snapshot.robots, snapshot.tracks
        return cls(
            time_s=snapshot.time_s,
            robots=tuple(
                RobotThen(
                    robot_id,
                    (float(robots.positions[i, 0]), float(robots.positions[i, 1])),
                    (float(robots.velocities[i, 0]), float(robots.velocities[i, 1])),
                    robots.links[i],
                    bool(robots.sensing_failed[i]),
                )
                for i, robot_id in enumerate(robots.ids)
            ),
            targets=tuple(
                TargetThen(
                    target_id,
                    (float(tracks.positions[j, 0]), float(tracks.positions[j, 1])),
                    (float(tracks.velocities[j, 0]), float(tracks.velocities[j, 1])),
                )
                for j, target_id in enumerate(tracks.ids)
                if tracks.status[j] in (TrackStatus.TRACKED, TrackStatus.COASTING)
            ),
            attacks=snapshot.attacks if attacks is None else tuple(attacks),
            assignment=snapshot.directives.assignment,
            weights=snapshot.directives.weights,
            trace=snapshot.trace,
        )


@dataclass(eq=False)
class History:
    """Keeps the last k results, `spacing_s` of mission time apart, and every attack between.

    Feed it every snapshot in order; read `entries` when a prompt is built. The newest entry
    is older than the snapshot it is read for by at most the spacing.
    """

    spacing_s: float = 1.0
    length: int = RESULTS
    _entries: deque[HistoryEntry] = field(default_factory=deque, init=False)
    _attacks: list[Attack] = field(default_factory=list, init=False)

    def record(self, snapshot: Snapshot) -> None:
        """Take note of a snapshot; it becomes an entry when the spacing has passed."""
        self._attacks.extend(snapshot.attacks)
        newest = self._entries[-1].time_s if self._entries else None
        # Half a microsecond of slack: sums of decimal steps fall short of their multiples.
        if newest is not None and snapshot.time_s < newest + self.spacing_s - 5e-7:
            return
        self._entries.append(HistoryEntry.of(snapshot, self._attacks))
        self._attacks.clear()
        while len(self._entries) > self.length:
            self._entries.popleft()

    @property
    def entries(self) -> tuple[HistoryEntry, ...]:
        """The last k results, oldest first."""
        return tuple(self._entries)

    @property
    def latest_attacks(self) -> tuple[Attack, ...]:
        """Attacks since the newest entry."""
        return tuple(self._attacks)
