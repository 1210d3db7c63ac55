"""Snapshots for the tests of assignments."""

from dataclasses import replace
from typing import Any

import numpy as np

from solver.arrays import frozen, frozen_bool
from solver.directives import Directives, Pairing, Pin, Weights
from solver.observations import HoldState, Link
from solver.snapshot import Guidance, RobotTable, Snapshot, TrackStatus, TrackTable
from solver.zones import Zone


def random_snapshot(
    seed: int,
    robots: int,
    targets: int,
    capacity: int,
    room: float = 5.0,
    zones: tuple[Zone, ...] = (),
) -> Snapshot:
    """Return a team at work with every target covered as well as capacities allow."""
    rng = np.random.default_rng(seed)
    ids, target_ids = tuple(range(21, 21 + robots)), tuple(range(122, 122 + targets))
    rows = np.resize(np.arange(robots), min(targets, robots * capacity))
    assignment = frozenset(
        Pairing(ids[i], t)
        for i, t in zip(rows.tolist(), rng.permutation(target_ids).tolist(), strict=False)
    )
    factors = rng.normal(size=(targets, 2, 2)) * 0.5
    covariances = factors @ np.swapaxes(factors, 1, 2) + 0.05 * np.eye(2)
    zero = np.zeros((robots, 2))
    return Snapshot(
        mission="m1",
        tick=0,
        time_s=10.0,
        robots=RobotTable(
            ids=ids,
            positions=frozen(rng.uniform(-room, room, size=(robots, 2))),
            velocities=frozen(zero),
            altitudes=frozen(np.ones(robots)),
            sensing_failed=frozen_bool(np.zeros(robots)),
            links=(Link.CONNECTED,) * robots,
            state_age_s=frozen(np.zeros(robots)),
            setpoint_velocities=frozen(zero),
            waypoints=frozen(zero),
        ),
        tracks=TrackTable(
            ids=target_ids,
            positions=frozen(rng.uniform(-room, room, size=(targets, 2))),
            velocities=frozen(rng.normal(size=(targets, 2)) * 0.1),
            covariances=frozen(covariances),
            unseen_s=frozen(np.zeros(targets)),
            status=(TrackStatus.TRACKED,) * targets,
        ),
        zones=zones,
        known=frozen_bool(np.ones((robots, len(zones)))),
        directives=Directives(
            assignment=assignment,
            weights=Weights(10.0, 0.05, 50.0, 50.0),
            capacities=tuple((robot_id, capacity) for robot_id in ids),
        ),
        hold=HoldState.FLYING,
        trace=0.0,
        solve=None,
        attacks=(),
        receipts=(),
        guidance=Guidance.SOLVER,
        guidance_age_s=0.0,
    )


def with_links(snapshot: Snapshot, **links: Link) -> Snapshot:
    """Return the snapshot with some robots' links changed, as r21=Link.LOST."""
    changed = tuple(
        links.get(f"r{robot_id}", link)
        for robot_id, link in zip(snapshot.robots.ids, snapshot.robots.links, strict=True)
    )
    return replace(snapshot, robots=replace(snapshot.robots, links=changed))


def blinded(snapshot: Snapshot, *robot_ids: int) -> Snapshot:
    """Return the snapshot with these robots in sensing failure."""
    failed = [robot_id in robot_ids for robot_id in snapshot.robots.ids]
    return replace(snapshot, robots=replace(snapshot.robots, sensing_failed=frozen_bool(failed)))


def dropped(snapshot: Snapshot, *target_ids: int) -> Snapshot:
    """Return the snapshot with these targets given up."""
    status = tuple(
        TrackStatus.DROPPED if target_id in target_ids else before
        for target_id, before in zip(snapshot.tracks.ids, snapshot.tracks.status, strict=True)
    )
    return replace(snapshot, tracks=replace(snapshot.tracks, status=status))


def directed(snapshot: Snapshot, **changes: Any) -> Snapshot:
    """Return the snapshot with other directives."""
    return replace(snapshot, directives=replace(snapshot.directives, **changes))


def pin(robot_id: int, target_id: int, name: str = "p", **rest: Any) -> Pin:
    """Return an operator's pin that never expires."""
    values: dict[str, Any] = {"expires_s": None, "comment_id": None, **rest}
    return Pin(id=name, pair=Pairing(robot_id, target_id), **values)
