"""What the stream says: snapshots and events as JSON values (docs/reference/stream.md).

Numbers are rounded to what a display can use, and JSON has no NaN or infinity: what is not a
finite number becomes null. Frame ENU, metres, seconds.
"""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any

import numpy as np

from server.loops import LoopReport
from solver.arrays import FloatArray
from solver.directives import CommentVerdict, Directives, Weights
from solver.observations import Link
from solver.snapshot import CommentReceipt, RobotTable, Snapshot, SolveSummary, TrackTable
from solver.zones import Point, Zone, ZoneKind

STREAM_VERSION = 1
"""The `v` of every message. A change that old readers would misread counts it up."""

Json = dict[str, Any]

_METRES = 3
_SQUARE_METRES = 6
_SECONDS = 3


class MissionState(StrEnum):
    """Where a mission stands."""

    CREATED = "created"
    RUNNING = "running"
    HELD = "held"
    """Flying, but told to stand still by a person."""

    PAUSED = "paused"
    """Mission time stands still; no set-point leaves."""

    ENDED = "ended"
    FAILED = "failed"
    """Its process is gone. Vehicles hold by themselves; `start` begins it afresh."""


class EventKind(StrEnum):
    """What an event is about."""

    COMMENT = "comment"
    PROPOSAL = "proposal"
    VERDICT = "verdict"
    DIRECTIVES = "directives"
    ATTACK = "attack"
    RECOVERY = "recovery"
    LINK = "link"
    ALARM = "alarm"
    HOLD = "hold"
    LOOP = "loop"
    ENDED = "ended"


class Severity(StrEnum):
    """How much an event wants to be looked at."""

    INFO = "info"
    WARNING = "warning"
    ALARM = "alarm"


def snapshot_message(
    snapshot: Snapshot,
    *,
    mission: str,
    state: MissionState,
    loops: Mapping[str, LoopReport],
    field: tuple[Point, Point],
    weight_bounds: tuple[Weights, Weights],
    attacks: Mapping[ZoneKind, int],
    truth: Json | None = None,
) -> Json:
    """Return the stream's message for one snapshot.

    `mission` is its id here; `field` and `weight_bounds` are (lower, upper); `attacks`
    counts hits since the start; `truth` is `truth_object` of a simulated world.
    """
    return {
        "type": "snapshot",
        "v": STREAM_VERSION,
        "mission": mission,
        "tick": snapshot.tick,
        "time_s": number(snapshot.time_s, _SECONDS),
        "state": state.value,
        "field": {"lower": list(field[0]), "upper": list(field[1])},
        "robots": _robots(snapshot.robots),
        "targets": _targets(snapshot.tracks),
        "zones": _zones(snapshot),
        "directives": _directives(snapshot.directives, weight_bounds),
        "solve": None if snapshot.solve is None else _solve(snapshot.solve),
        "trace": number(snapshot.trace, _SQUARE_METRES),
        "guidance": {
            "level": snapshot.guidance.value,
            "age_s": number(snapshot.guidance_age_s, 1),
        },
        "loops": {name: _loop(report) for name, report in loops.items()},
        "attacks": {kind.value: attacks.get(kind, 0) for kind in ZoneKind},
        "comments": [comment_object(r) for r in (*snapshot.closed, *snapshot.receipts)],
        "truth": truth,
    }


def event_message(
    mission: str,
    seq: int,
    time_s: float,
    kind: EventKind,
    severity: Severity,
    text: str,
    data: Mapping[str, Any] | None = None,
) -> Json:
    """Return the stream's message for one event; `text` is plain words for people."""
    return {
        "type": "event",
        "v": STREAM_VERSION,
        "mission": mission,
        "seq": seq,
        "time_s": number(time_s, _SECONDS),
        "kind": kind.value,
        "severity": severity.value,
        "text": text,
        "data": dict(data or {}),
    }


def truth_object(
    robots: Mapping[int, tuple[float, float]],
    targets: Mapping[int, tuple[float, float]],
    zones: Sequence[Zone],
) -> Json:
    """Return what a simulated world knows: true places, and zones nobody has found yet."""
    return {
        "robots": [{"id": i, "position": numbers(p, _METRES)} for i, p in robots.items()],
        "targets": [{"id": i, "position": numbers(p, _METRES)} for i, p in targets.items()],
        "zones": [
            {
                "id": zone.id,
                "kind": zone.kind.value,
                "mean": numbers(zone.mean, _METRES),
                "covariance": rounded(np.asarray(zone.covariance), _SQUARE_METRES),
            }
            for zone in zones
        ],
    }


def comment_object(receipt: CommentReceipt) -> Json:
    """Return a comment with its receipt: where it stands and what each loop answered."""
    comment = receipt.comment
    return {
        "id": comment.id,
        "text": comment.text,
        "author": comment.author,
        "time_s": number(comment.time_s, _SECONDS),
        "expires_s": number(comment.time_s + comment.ttl_s, _SECONDS),
        "status": receipt.status,
        "task": _answer(receipt.task, receipt.task_reason),
        "action": _answer(receipt.action, receipt.action_reason),
    }


def keep_out_axes_m(zone: Zone, severity: float, spread_m: float) -> tuple[float, float]:
    """Return how far the zone repels along its long and its short axis, metres.

    DESIGN 4: quantile * sqrt(n'Sn) plus the margin; for a communication zone the margin is
    a factor on the spread of the team, the largest distance between two connected robots.
    """
    short, long = np.sqrt(np.linalg.eigvalsh(np.asarray(zone.covariance)))
    margin_m = zone.margin if zone.kind is ZoneKind.SENSING else zone.margin * spread_m
    quantile = zone.quantile(severity)
    return float(quantile * long + margin_m), float(quantile * short + margin_m)


def number(value: float | None, digits: int) -> float | None:
    """Return a rounded number, None for what JSON cannot say."""
    if value is None or not np.isfinite(value):
        return None
    return round(float(value), digits)


def numbers(values: Sequence[float] | FloatArray, digits: int) -> list[float] | None:
    """Return rounded numbers, None unless all are finite."""
    array = np.asarray(values, dtype=float)
    return np.round(array, digits).tolist() if np.isfinite(array).all() else None


def rounded(matrix: FloatArray, digits: int) -> list[list[float]] | None:
    """Return a rounded matrix as rows, None unless all entries are finite."""
    return np.round(matrix, digits).tolist() if np.isfinite(matrix).all() else None


def _robots(table: RobotTable) -> list[Json]:
    return [
        {
            "id": robot_id,
            "position": numbers([*table.positions[i], table.altitudes[i]], _METRES),
            "velocity": numbers(table.velocities[i], _METRES),
            "link": table.links[i].value,
            "sensing_failed": bool(table.sensing_failed[i]),
            "setpoint": numbers(table.setpoint_velocities[i], _METRES),
            "waypoint": numbers([*table.waypoints[i], table.altitudes[i]], _METRES),
            "state_age_s": number(table.state_age_s[i], 2),
        }
        for i, robot_id in enumerate(table.ids)
    ]


def _targets(table: TrackTable) -> list[Json]:
    return [
        {
            "id": target_id,
            "position": numbers(table.positions[i], _METRES),
            "velocity": numbers(table.velocities[i], _METRES),
            "covariance": rounded(table.covariances[i], _SQUARE_METRES),
            "unseen_s": number(table.unseen_s[i], 1),
            "status": table.status[i].value,
        }
        for i, target_id in enumerate(table.ids)
    ]


def _zones(snapshot: Snapshot) -> list[Json]:
    spread_m = _spread_m(snapshot.robots)
    found = []
    for column, zone in enumerate(snapshot.zones):
        severity = snapshot.directives.severity_of(zone.id)
        holders = np.flatnonzero(snapshot.known[:, column])
        axes_m = keep_out_axes_m(zone, severity, spread_m)
        found.append(
            {
                "id": zone.id,
                "kind": zone.kind.value,
                "mean": numbers(zone.mean, _METRES),
                "covariance": rounded(np.asarray(zone.covariance), _SQUARE_METRES),
                "margin": zone.margin,
                "risk": zone.risk,
                "severity": number(severity, 3),
                "keep_out_m": number(axes_m[0], _METRES),
                "keep_out_axes_m": numbers(axes_m, _METRES),
                "known_by": [snapshot.robots.ids[row] for row in holders],
            }
        )
    return found


def _spread_m(table: RobotTable) -> float:
    """Return the largest distance between two connected robots, 0 for fewer than two."""
    rows = [i for i, link in enumerate(table.links) if link is Link.CONNECTED]
    places = table.positions[rows]
    offsets = places[:, None, :] - places[None, :, :]
    return float(np.sqrt((offsets**2).sum(axis=-1)).max(initial=0.0))


def _directives(directives: Directives, weight_bounds: tuple[Weights, Weights]) -> Json:
    lower, upper = weight_bounds
    return {
        "assignment": {
            str(robot_id): list(directives.targets_of(robot_id))
            for robot_id, _ in directives.capacities
        },
        "weights": directives.weights._asdict(),
        "weight_bounds": {
            name: [getattr(lower, name), getattr(upper, name)] for name in Weights._fields
        },
        "capacities": {str(robot_id): capacity for robot_id, capacity in directives.capacities},
        "severities": dict(directives.severities),
        "pins": [
            {
                "id": pin.id,
                "robot": pin.pair.robot_id,
                "target": pin.pair.target_id,
                "expires_s": number(pin.expires_s, _SECONDS),
                "comment": pin.comment_id,
                "forbids": pin.forbids,
            }
            for pin in directives.pins
        ],
        "assignment_source": directives.assignment_source.value,
        "assignment_since_s": number(directives.assignment_since_s, _SECONDS),
        "weights_source": directives.weights_source.value,
        "weights_since_s": number(directives.weights_since_s, _SECONDS),
    }


def _solve(solve: SolveSummary) -> Json:
    return {
        "rung": solve.rung.value,
        "solve_ms": number(1e3 * solve.solve_s, 3),
        "iterations": solve.iterations,
    }


def _loop(report: LoopReport) -> Json:
    return {
        "rate_hz": number(report.rate_hz, 3),
        "mean_s": number(report.mean_s, 4),
        "success_rate": number(report.success_rate, 3),
        "age_s": number(report.age_s, 1),
        "calls": report.calls,
        "missed": report.missed,
    }


def _answer(verdict: CommentVerdict | None, reason: str) -> Json | None:
    return None if verdict is None else {"verdict": verdict.value, "reason": reason}
