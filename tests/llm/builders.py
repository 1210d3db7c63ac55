"""Snapshots for the tests of the language layer, made from a few words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from llm.verification import Limits
from solver.arrays import frozen, frozen_bool
from solver.directives import Directives, Pairing, Pin, Weights
from solver.observations import Attack, Comment, HoldState, Link
from solver.problem import Rung
from solver.snapshot import (
    CommentReceipt,
    Guidance,
    RobotTable,
    Snapshot,
    SolveSummary,
    TrackStatus,
    TrackTable,
)
from solver.zones import Point, Zone, ZoneKind

WEIGHTS = Weights(10.0, 0.05, 50.0, 50.0)
LIMITS = Limits.around(WEIGHTS)


@dataclass
class Scene:
    """What a test wants to say; everything else is quiet and healthy."""

    robots: Mapping[int, Point]
    targets: Mapping[int, Point]
    rows: Mapping[int, Sequence[int]]
    capacity: int | Mapping[int, int] = 2
    velocities: Mapping[int, Point] = field(default_factory=dict)
    target_velocities: Mapping[int, Point] = field(default_factory=dict)
    links: Mapping[int, Link] = field(default_factory=dict)
    blind: Sequence[int] = ()
    dropped: Sequence[int] = ()
    zones: Sequence[Zone] = ()
    unaware: Mapping[int, Sequence[str]] = field(default_factory=dict)
    """Zones a robot does not know."""

    weights: Weights = WEIGHTS
    severities: Mapping[str, float] = field(default_factory=dict)
    pins: Sequence[Pin] = ()
    attacks: Sequence[Attack] = ()
    receipts: Sequence[CommentReceipt] = ()
    setpoints: Mapping[int, Point] = field(default_factory=dict)
    rung: Rung = Rung.CONVERGED
    time_s: float = 10.0
    trace: float = 0.42

    def snapshot(self) -> Snapshot:
        ids, target_ids = tuple(self.robots), tuple(self.targets)
        capacities = (
            dict.fromkeys(ids, self.capacity) if isinstance(self.capacity, int) else self.capacity
        )
        directives = Directives(
            assignment=frozenset(Pairing(i, j) for i, row in self.rows.items() for j in row),
            weights=self.weights,
            capacities=tuple((i, capacities[i]) for i in ids),
            severities=tuple(self.severities.items()),
            pins=tuple(self.pins),
        )
        return Snapshot(
            mission="m1",
            tick=int(self.time_s / 0.5),
            time_s=self.time_s,
            robots=self._robots(ids),
            tracks=self._tracks(target_ids),
            zones=tuple(self.zones),
            known=frozen_bool(
                np.array(
                    [[z.id not in self.unaware.get(i, ()) for z in self.zones] for i in ids]
                ).reshape(len(ids), len(self.zones))
            ),
            directives=directives,
            hold=HoldState.FLYING,
            trace=self.trace,
            solve=SolveSummary(self.rung, 1.25, 6, 0.002),
            attacks=tuple(self.attacks),
            receipts=tuple(self.receipts),
            guidance=Guidance.MODEL,
            guidance_age_s=1.0,
        )

    def _robots(self, ids: tuple[int, ...]) -> RobotTable:
        count = len(ids)
        return RobotTable(
            ids=ids,
            positions=frozen([self.robots[i] for i in ids]),
            velocities=frozen([self.velocities.get(i, (0.0, 0.0)) for i in ids]),
            altitudes=frozen(np.full(count, 1.5)),
            sensing_failed=frozen_bool([i in self.blind for i in ids]),
            links=tuple(self.links.get(i, Link.CONNECTED) for i in ids),
            state_age_s=frozen(np.zeros(count)),
            setpoint_velocities=frozen([self.setpoints.get(i, (0.0, 0.0)) for i in ids]),
            waypoints=frozen([self.robots[i] for i in ids]),
        )

    def _tracks(self, ids: tuple[int, ...]) -> TrackTable:
        count = len(ids)
        return TrackTable(
            ids=ids,
            positions=frozen([self.targets[j] for j in ids]),
            velocities=frozen([self.target_velocities.get(j, (0.0, 0.0)) for j in ids]),
            covariances=frozen(np.tile(0.1 * np.eye(2), (count, 1, 1))),
            unseen_s=frozen(np.zeros(count)),
            status=tuple(
                TrackStatus.DROPPED if j in self.dropped else TrackStatus.TRACKED for j in ids
            ),
        )

    def saying(self, *texts: str, age_s: float = 1.0) -> "Scene":
        """Return the scene with comments c1, c2, ... standing."""
        receipts = tuple(
            CommentReceipt(Comment(f"c{k}", text, self.time_s - age_s, 120.0))
            for k, text in enumerate(texts, start=1)
        )
        return replace(self, receipts=receipts)


def zone(
    zone_id: str,
    kind: ZoneKind = ZoneKind.SENSING,
    mean: Point = (0.0, 0.0),
    variance: float = 0.5,
    margin: float = 0.1,
) -> Zone:
    covariance = ((variance, 0.0), (0.0, variance))
    return Zone(zone_id, kind, mean, covariance, margin, risk=0.1)


def hardware() -> Scene:
    """The paper's hardware case: drones 21 and 26, targets 122 and 124, three zones."""
    return Scene(
        robots={21: (-2.0, 1.0), 26: (-2.0, -1.0)},
        targets={122: (0.0, 1.2), 124: (0.0, -1.2)},
        rows={21: [122], 26: [124]},
        target_velocities={122: (0.1, 0.0), 124: (0.1, 0.0)},
        zones=(
            zone("s1", mean=(2.0, 1.5)),
            zone("s2", mean=(4.0, -1.5)),
            zone("c1", ZoneKind.COMMUNICATION, mean=(3.0, 0.0), margin=0.2),
        ),
    )


def ablation() -> Scene:
    """The authors' two robots and four targets, capacities full."""
    return Scene(
        robots={0: (-8.5, 0.8), 1: (-8.5, -0.5)},
        targets={0: (-6.0, 1.2), 1: (-7.5, 0.5), 2: (-6.0, -0.3), 3: (-7.5, -1.2)},
        rows={0: [0, 2], 1: [1, 3]},
        target_velocities={0: (0.08, 0.0), 1: (0.1, 0.0), 2: (0.08, 0.0), 3: (0.1, 0.0)},
    )
