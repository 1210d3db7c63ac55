"""A snapshot in words: what both models are told about robots, targets and zones.

Stable in order (team and mission order) and rounded, so that equal situations give equal
prompts. Zone names appear as labels only (`llm.quoting`).
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from llm import words
from llm.coverage import Team, standing_pins
from llm.history import HistoryEntry, RobotThen
from llm.quoting import labels
from solver.arrays import FloatArray
from solver.directives import Pairing
from solver.observations import Attack, Link
from solver.snapshot import InferredZone, Snapshot, TrackStatus
from solver.zones import Zone, ZoneKind

NEAR_M = 3.0
"""Robots farther than this outside a zone's keep-out are not mentioned beside it."""

STILL_M_S = 0.05
STILL_FOR_S = 2.0
"""A robot stands still that stays this slow for this long."""

MOST_ATTACKS = 8


def point(values: Sequence[float] | FloatArray) -> str:
    """Write a pair of coordinates, to the centimetre."""
    parts = [f"{float(v):.2f}".rstrip("0").rstrip(".") for v in values]
    return f"({', '.join('0' if p == '-0' else p for p in parts)})"


def seconds(time_s: float) -> str:
    """Write a time, to a tenth of a second."""
    return f"{time_s:.1f}".removesuffix(".0")


def zone_labels(snapshot: Snapshot) -> Mapping[str, str]:
    """Return zone id -> label, in the snapshot's order."""
    return labels(zone.id for zone in snapshot.zones)


def condition(link: Link, *, blind: bool) -> str:
    """Say what has failed on a robot."""
    if link is Link.LOST:
        return "lost"
    failures = []
    if blind:
        failures.append("in sensing failure")
    if link is Link.JAMMED:
        failures.append("cut off by communication failure")
    return " and ".join(failures) or "healthy"


def robot_lines(snapshot: Snapshot, team: Team) -> Iterator[str]:
    """Tell every robot's state, failures, capacity and targets."""
    robots, rows = snapshot.robots, _rows(snapshot.directives.assignment)
    for i, robot_id in enumerate(robots.ids):
        state = condition(robots.links[i], blind=bool(robots.sensing_failed[i]))
        head = f"Drone {robot_id} is at {point(robots.positions[i])}"
        if robots.links[i] is Link.LOST:
            yield f"{head} by its last report, lost."
            continue
        row = rows.get(robot_id, ())
        tracks = words.targets(row) if row else "no target"
        capacity = team.capacities[robot_id]
        able = (
            "its targets cannot be changed"
            if robot_id in team.frozen
            else f"can track at most {capacity} target{'' if capacity == 1 else 's'}"
        )
        yield (
            f"{head}, velocity {point(robots.velocities[i])}, commanded "
            f"{point(robots.setpoint_velocities[i])}, {state}; it tracks {tracks}, {able}."
        )


def _rows(assignment: Iterable[Pairing]) -> dict[int, list[int]]:
    """Return robot id -> its targets, ascending."""
    rows: dict[int, list[int]] = {}
    for robot_id, target_id in sorted(assignment):
        rows.setdefault(robot_id, []).append(target_id)
    return rows


def still_lines(snapshot: Snapshot, history: Sequence[HistoryEntry]) -> Iterator[str]:
    """Tell which robots have hardly moved over the recent results, though they can be reached."""
    span_s = snapshot.time_s - history[0].time_s if history else 0.0
    if span_s < STILL_FOR_S:
        return
    robots = snapshot.robots
    places = [{robot.robot_id: robot.position for robot in entry.robots} for entry in history]
    for i, robot_id in enumerate(robots.ids):
        if robots.links[i] is not Link.CONNECTED or not all(robot_id in at for at in places):
            continue
        here = robots.positions[i]
        moved_m = max(float(np.hypot(*(here - np.asarray(at[robot_id])))) for at in places)
        if moved_m < STILL_M_S * span_s:
            yield (
                f"Drone {robot_id} stands still: it has moved {words.number(round(moved_m, 2))} m "
                f"in {seconds(span_s)} s."
            )


def target_lines(snapshot: Snapshot) -> Iterator[str]:
    """Tell every target's estimate and how sure it is; dropped targets are left out."""
    tracks = snapshot.tracks
    for j, target_id in enumerate(tracks.ids):
        status = tracks.status[j]
        if status is TrackStatus.UNKNOWN:
            yield f"Target {target_id} has not been seen yet."
        elif status is not TrackStatus.DROPPED:
            unseen = (
                "seen now"
                if status is TrackStatus.TRACKED
                else f"not seen for {seconds(float(tracks.unseen_s[j]))} s"
            )
            variance = words.number(round(float(np.trace(tracks.covariances[j])), 3))
            yield (
                f"Target {target_id} is at {point(tracks.positions[j])}, velocity "
                f"{point(tracks.velocities[j])}, trace {variance}, {unseen}."
            )


def keep_out_m(zone: Zone, severity: float, spread_m: float) -> float:
    """Return the mean radius of a zone's keep-out (paper, section III-B)."""
    deviation = math.sqrt(0.5 * (zone.covariance[0][0] + zone.covariance[1][1]))
    return float(zone.quantile(severity) * deviation + _margin(zone, spread_m))


def clearances_m(zone: Zone, severity: float, spreads_m: FloatArray, at: FloatArray) -> FloatArray:
    """Return how far points are outside a zone's keep-out; negative inside.

    The exact constraint of the optimizer: |a| - q sqrt(n'Sn) - r with a = mu - x, n = a/|a|.

    Args:
        zone: The zone.
        severity: Its multiplier.
        spreads_m: (P,) or scalar: the spread of the team that counts at each point.
        at: (P, 2) points.
    """
    away = np.asarray(zone.mean) - at
    distance = np.hypot(away[:, 0], away[:, 1])
    far = distance > 1e-9
    direction = np.where(far[:, None], away / np.where(far, distance, 1.0)[:, None], (1.0, 0.0))
    deviation = np.sqrt(np.sum((direction @ np.asarray(zone.covariance)) * direction, axis=1))
    margins = np.broadcast_to(_margin(zone, spreads_m), distance.shape)
    return np.asarray(distance - zone.quantile(severity) * deviation - margins)


def _margin(zone: Zone, spread_m: float | FloatArray) -> float | FloatArray:
    return zone.margin * (spread_m if zone.kind is ZoneKind.COMMUNICATION else 1.0)


def spreads_m(snapshot: Snapshot) -> FloatArray:
    """Return (M,) the distance from each robot to its farthest connected team mate."""
    robots = snapshot.robots
    mates = [k for k, link in enumerate(robots.links) if link is Link.CONNECTED]
    offsets = robots.positions[:, None, :] - robots.positions[mates][None, :, :]
    return np.asarray(np.hypot(offsets[..., 0], offsets[..., 1]).max(axis=1, initial=0.0))


def zone_lines(snapshot: Snapshot) -> Iterator[str]:
    """Tell every known zone of both kinds, who knows it and what it does to whom."""
    if not snapshot.zones:
        yield "No danger zone is known yet."
    names = zone_labels(snapshot)
    ids = np.asarray(snapshot.robots.ids)
    reachable = [i for i, link in enumerate(snapshot.robots.links) if link is Link.CONNECTED]
    spreads = spreads_m(snapshot)
    spread_m = float(spreads[reachable].max(initial=0.0))
    inferred = {one.zone_id: one for one in snapshot.inferred}
    for z, zone in enumerate(snapshot.zones):
        severity = snapshot.directives.severity_of(zone.id)
        knowing = [int(r) for r in ids[snapshot.known[:, z]]]
        everybody = len(knowing) == len(ids)
        known_by = "all drones" if everybody else words.drones(knowing) or "no drone"
        growing = ", growing with the spread of the team" * (zone.kind is ZoneKind.COMMUNICATION)
        radius = words.number(round(keep_out_m(zone, severity, spread_m), 2))
        effects = list(_effects(snapshot, zone, severity, spreads))
        effect = f" {'; '.join(effects)}." if effects else " No drone or target is near it."
        yield (
            f"{zone.kind.value.capitalize()} zone {names[zone.id]} is at {point(zone.mean)}, "
            f"keep-out {radius} m{growing}{_doubt(inferred.get(zone.id))}, severity "
            f"{words.number(severity)}, known by {known_by}.{effect}"
        )


def _doubt(inferred: InferredZone | None) -> str:
    """Tell how sure it is that a zone which was only inferred exists, and where."""
    if inferred is None:
        return ""
    sure = f"{100.0 * inferred.confidence:.0f} % sure"
    return f", inferred from failures ({sure}, centre to {inferred.centre_deviation_m:.1f} m)"


def _effects(snapshot: Snapshot, zone: Zone, severity: float, spreads: FloatArray) -> Iterator[str]:
    robots, tracks = snapshot.robots, snapshot.tracks
    clearances = clearances_m(zone, severity, spreads, robots.positions)
    for i in np.flatnonzero(clearances < NEAR_M):
        if robots.links[i] is Link.LOST:
            continue
        clearance = float(clearances[i])
        if clearance < 0.0:
            yield f"Drone {robots.ids[i]} is inside its keep-out by {-clearance:.2f} m"
        else:
            yield f"Drone {robots.ids[i]} is {clearance:.2f} m outside"
    inside = clearances_m(zone, severity, np.zeros(len(tracks.ids)), tracks.positions) < 0.0
    for j in np.flatnonzero(inside):
        if tracks.status[j] not in (TrackStatus.UNKNOWN, TrackStatus.DROPPED):
            yield f"Target {tracks.ids[j]} is inside it"


def attack_words(attack: Attack, names: Mapping[str, str]) -> str:
    """Tell one attack."""
    known = names.get(attack.zone.id) if attack.zone is not None else None
    source = (
        f"{attack.kind.value} zone {known}" if known else f"an unknown {attack.kind.value} zone"
    )
    return f"Drone {attack.robot_id} by {source}"


def attack_line(
    snapshot: Snapshot, history: Sequence[HistoryEntry], latest: Sequence[Attack]
) -> str:
    """Tell the attacks since the newest result of the history, and the count before."""
    names = zone_labels(snapshot)
    told = [attack_words(a, names) for a in latest]
    earlier = sum(len(entry.attacks) for entry in history)
    if not told and not earlier:
        return "No attack has been detected lately."
    if not told:
        return f"No new attack; {earlier} in the recent results."
    more = f" and {len(told) - MOST_ATTACKS} more" if len(told) > MOST_ATTACKS else ""
    return f"New attacks: {'; '.join(told[-MOST_ATTACKS:])}{more}."


def pin_lines(snapshot: Snapshot, team: Team, comments: Mapping[str, str]) -> Iterator[str]:
    """Tell the pairs that are fixed, and by whom.

    Args:
        snapshot: The pins in force.
        team: The team at the snapshot.
        comments: Comment id -> label.
    """
    for pin in standing_pins(snapshot, team):
        verb = "must not track" if pin.forbids else "must keep"
        by = (
            "by the operator"
            if pin.comment_id is None
            else f"by comment {comments.get(pin.comment_id, 'before')}"
        )
        yield f"Drone {pin.pair.robot_id} {verb} Target {pin.pair.target_id}, {by}."


def history_lines(history: Sequence[HistoryEntry], names: Mapping[str, str]) -> Iterator[str]:
    """Tell the last results, oldest first, one per line."""
    for index, entry in enumerate(history, start=1):
        robots = "; ".join(_robot_then(robot) for robot in entry.robots)
        targets = "; ".join(
            f"Target {t.target_id} at {point(t.position)} velocity {point(t.velocity)}"
            for t in entry.targets
        )
        attacks = "; ".join(attack_words(a, names) for a in entry.attacks[-MOST_ATTACKS:])
        rows = _rows(entry.assignment)
        pairs = "; ".join(
            f"Drone {robot.robot_id} tracked {words.targets(rows[robot.robot_id])}"
            for robot in entry.robots
            if robot.robot_id in rows
        )
        yield (
            f"{index}. At {seconds(entry.time_s)} s: {robots}; {targets or 'no target seen'}. "
            f"Attacked: {attacks or 'nobody'}. {pairs or 'No drone tracked anything'}. "
            f"Trace {words.number(round(entry.trace, 3))}."
        )


def _robot_then(robot: RobotThen) -> str:
    state = condition(robot.link, blind=robot.sensing_failed)
    suffix = "" if state == "healthy" else f", {state}"
    return (
        f"Drone {robot.robot_id} at {point(robot.position)} velocity "
        f"{point(robot.velocity)}{suffix}"
    )
