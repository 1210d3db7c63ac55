"""What the stream says: snapshots and events as JSON values (docs/reference/stream.md).

Numbers are rounded to what a display can use, and JSON has no NaN or infinity: what is not a
finite number becomes null. Frame ENU, metres, seconds.
"""

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any

import numpy as np

from server.loops import LoopReport
from server.mission.setup import ZoneDefaults
from solver.arrays import FloatArray
from solver.directives import CommentVerdict, Directives, Weights
from solver.observations import Link
from solver.snapshot import (
    CommentReceipt,
    InferredZone,
    RobotTable,
    Snapshot,
    SolveSummary,
    TrackTable,
)
from solver.zones import Point, Zone, ZoneKind

STREAM_VERSION = 1
"""The `v` of every message. A change that old readers would misread counts it up."""

Json = dict[str, Any]

_METRES = 3
_SQUARE_METRES = 6
_SECONDS = 3
_STAMP = 4


class MissionState(StrEnum):
    """Where a mission stands."""

    CREATED = "created"
    QUEUED = "queued"
    """In lockstep: waiting for a process to be free."""

    RUNNING = "running"
    HELD = "held"
    """Flying, but told to stand still by a person."""

    PAUSED = "paused"
    """Mission time stands still; no set-point leaves."""

    ENDED = "ended"
    FAILED = "failed"
    """Its process is gone. Vehicles hold by themselves; `start` brings it up held, where it was."""


class EventKind(StrEnum):
    """What an event is about."""

    COMMENT = "comment"
    PROPOSAL = "proposal"
    VERDICT = "verdict"
    DECISION = "decision"
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
    severity_bounds: tuple[float, float],
    zone_defaults: Mapping[ZoneKind, ZoneDefaults],
    attacks: Mapping[ZoneKind, int],
    truth: Json | None = None,
    stamp_s: float | None = None,
) -> Json:
    """Return the stream's message for one snapshot.

    `mission` is its id here; `field` and the bounds are (lower, upper); `zone_defaults` say what
    a drawn zone gets; `attacks` counts hits since the start; `truth` is `truth_object` of a
    simulated world; `stamp_s` is this machine's monotonic clock, where time is real.
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
        "zone_defaults": {
            kind.value: {"margin": zone_defaults[kind].margin, "risk": zone_defaults[kind].risk}
            for kind in ZoneKind
        },
        "directives": _directives(snapshot.directives, weight_bounds, severity_bounds),
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
        "stamp_s": number(stamp_s, _STAMP),
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
        "robots": _places(robots),
        "targets": _places(targets),
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
        **loop_answers(receipt),
    }


def loop_answers(receipt: CommentReceipt) -> Json:
    """Return what each loop answered to a comment, and the proposal that it answered with."""
    r = receipt
    return {
        "task": _answer(r.task, r.task_reason, r.task_feedback, r.task_proposal),
        "action": _answer(r.action, r.action_reason, r.action_feedback, r.action_proposal),
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
    if value is None or not math.isfinite(value):
        return None
    return round(float(value), digits)


def numbers(values: Sequence[float] | FloatArray, digits: int) -> list[float] | None:
    """Return rounded numbers, None unless all are finite."""
    array = np.asarray(values, dtype=float)
    return np.round(array, digits).tolist() if np.isfinite(array).all() else None


def rounded(matrix: FloatArray, digits: int) -> list[list[float]] | None:
    """Return a rounded matrix as rows, None unless all entries are finite."""
    return np.round(matrix, digits).tolist() if np.isfinite(matrix).all() else None


def _rows(table: FloatArray, digits: int) -> list[Any]:
    """Return each row of an array as `rounded` would, at once: one row per robot or target."""
    axes = tuple(range(1, table.ndim))
    finite = np.asarray(np.isfinite(table).all(axis=axes))
    rows = np.round(table, digits).tolist()
    return [row if good else None for row, good in zip(rows, finite, strict=True)]


def _places(places: Mapping[int, tuple[float, float]]) -> list[Json]:
    rows = _rows(np.array(list(places.values()), dtype=float).reshape(-1, 2), _METRES)
    return [{"id": i, "position": row} for i, row in zip(places, rows, strict=True)]


def _robots(table: RobotTable) -> list[Json]:
    heights = np.asarray(table.altitudes, dtype=float)
    positions = _rows(np.column_stack((table.positions, heights)), _METRES)
    waypoints = _rows(np.column_stack((table.waypoints, heights)), _METRES)
    velocities = _rows(table.velocities, _METRES)
    setpoints = _rows(table.setpoint_velocities, _METRES)
    return [
        {
            "id": robot_id,
            "position": positions[i],
            "velocity": velocities[i],
            "link": table.links[i].value,
            "sensing_failed": bool(table.sensing_failed[i]),
            "setpoint": setpoints[i],
            "waypoint": waypoints[i],
            "state_age_s": number(table.state_age_s[i], 2),
        }
        for i, robot_id in enumerate(table.ids)
    ]


def _targets(table: TrackTable) -> list[Json]:
    positions = _rows(table.positions, _METRES)
    velocities = _rows(table.velocities, _METRES)
    covariances = _rows(table.covariances, _SQUARE_METRES)
    return [
        {
            "id": target_id,
            "position": positions[i],
            "velocity": velocities[i],
            "covariance": covariances[i],
            "unseen_s": number(table.unseen_s[i], 1),
            "status": table.status[i].value,
        }
        for i, target_id in enumerate(table.ids)
    ]


def _zones(snapshot: Snapshot) -> list[Json]:
    spread_m = _spread_m(snapshot.robots)
    inferred = {one.zone_id: one for one in snapshot.inferred}
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
                **_origin(inferred.get(zone.id)),
            }
        )
    return found


def _origin(inferred: InferredZone | None) -> Json:
    """Return how a zone became known, and how sure that is where it was inferred."""
    if inferred is None:
        return {"origin": "told", "confidence": None, "inferred": None}
    return {
        "origin": "inferred",
        "confidence": number(inferred.confidence, 3),
        "inferred": {
            "extent": rounded(np.asarray(inferred.extent), _SQUARE_METRES),
            "centre_covariance": rounded(np.asarray(inferred.centre_covariance), _SQUARE_METRES),
            "strength": number(inferred.strength, 3),
            "strength_deviation": number(inferred.strength_deviation, 3),
            "since_s": number(inferred.since_s, _SECONDS),
        },
    }


def _spread_m(table: RobotTable) -> float:
    """Return the largest distance between two connected robots, 0 for fewer than two."""
    rows = [i for i, link in enumerate(table.links) if link is Link.CONNECTED]
    places = table.positions[rows]
    offsets = places[:, None, :] - places[None, :, :]
    return float(np.sqrt((offsets**2).sum(axis=-1)).max(initial=0.0))


def _directives(
    directives: Directives,
    weight_bounds: tuple[Weights, Weights],
    severity_bounds: tuple[float, float],
) -> Json:
    lower, upper = weight_bounds
    rows = directives.rows()
    return {
        "assignment": {
            str(robot_id): list(rows.get(robot_id, ())) for robot_id, _ in directives.capacities
        },
        "weights": directives.weights._asdict(),
        "weight_bounds": {
            name: [getattr(lower, name), getattr(upper, name)] for name in Weights._fields
        },
        "capacities": {str(robot_id): capacity for robot_id, capacity in directives.capacities},
        "severities": dict(directives.severities),
        "severity_bounds": list(severity_bounds),
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
        "adopted_rate": number(report.adopted_rate, 3),
        "age_s": number(report.age_s, 1),
        "waits_for_person": report.waits_for_person,
        "calls": report.calls,
        "missed": report.missed,
    }


def _answer(
    verdict: CommentVerdict | None, reason: str, feedback: str, proposal: str
) -> Json | None:
    if verdict is None:
        return None
    return {
        "verdict": verdict.value,
        "reason": reason,
        "feedback": feedback,
        "proposal": proposal,
    }
