"""The picture of a snapshot as a Foxglove SceneUpdate, and events as Foxglove logs.

Made from the stream's messages, which is all that people are shown. One entity per kind of thing,
replaced as a whole by the next update: nothing that has gone stays on the picture. Frame
`field` (ENU, metres); targets and zones lie on the ground.
"""

import math
from typing import Any, Final

import numpy as np

from server.encoding import Severity

Json = dict[str, Any]

FRAME: Final = "field"
NANOSECONDS: Final = 1_000_000_000
LEVELS: Final = {Severity.INFO.value: 2, Severity.WARNING.value: 3, Severity.ALARM.value: 4}
"""Foxglove's log levels: info, warning, error."""

_LINE_STRIP: Final = 0
_LINE_LOOP: Final = 1
_CORNERS: Final = 48
_SIGMAS: Final = 2.0
_ROBOT_M: Final = 0.3
_TARGET_M: Final = 0.2

_ROBOT: Final = (0.16, 0.45, 0.80, 1.0)
_FAILED: Final = (0.90, 0.55, 0.10, 1.0)
_LOST: Final = (0.55, 0.55, 0.55, 1.0)
_TARGET: Final = (0.20, 0.60, 0.35, 1.0)
_ASSIGNED: Final = (0.35, 0.35, 0.40, 0.8)
_ZONE_COLOURS: Final = {
    "sensing": (0.80, 0.18, 0.18, 0.9),
    "communication": (0.15, 0.35, 0.85, 0.9),
}
_UNDISCOVERED: Final = (0.6, 0.6, 0.6, 0.5)


def stamp(time_s: float) -> Json:
    """Return mission time as Foxglove writes it."""
    whole = int(time_s * NANOSECONDS)
    return {"sec": whole // NANOSECONDS, "nsec": whole % NANOSECONDS}


def scene_update(snapshot: Json) -> Json:
    """Return the scene of a snapshot message."""
    at = stamp(snapshot["time_s"])
    robots = [robot for robot in snapshot["robots"] if robot["position"] is not None]
    targets = [target for target in snapshot["targets"] if target["position"] is not None]
    return {
        "deletions": [],
        "entities": [
            _entity("robots", at, spheres=[_robot(robot) for robot in robots]),
            _entity("targets", at, cylinders=[_target(target) for target in targets]),
            _entity("uncertainty", at, lines=[e for t in targets if (e := _uncertainty(t))]),
            _entity("assignment", at, lines=_assignment(snapshot, robots, targets)),
            _entity("zones", at, lines=_zones(snapshot)),
            _entity(
                "names",
                at,
                texts=[_name(one, "R") for one in robots] + [_name(one, "T") for one in targets],
            ),
        ],
    }


def log_message(event: Json) -> Json:
    """Return an event message as a log line."""
    return {
        "timestamp": stamp(event["time_s"]),
        "level": LEVELS[event["severity"]],
        "message": event["text"],
        "name": event["kind"],
        "file": "",
        "line": 0,
    }


def _entity(name: str, at: Json, **primitives: list[Json]) -> Json:
    empty: Json = {
        kind: []
        for kind in (
            "arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models",
        )
    }  # fmt: skip
    return {
        "timestamp": at,
        "frame_id": FRAME,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [],
        **empty,
        **primitives,
    }


def _robot(robot: Json) -> Json:
    failed = robot["sensing_failed"] or robot["link"] == "jammed"
    colour = _LOST if robot["link"] == "lost" else _FAILED if failed else _ROBOT
    return {
        "pose": _pose(robot["position"]),
        "size": _vector(_ROBOT_M, _ROBOT_M, _ROBOT_M),
        "color": _colour(colour),
    }


def _target(target: Json) -> Json:
    return {
        "pose": _pose([*target["position"], 0.5 * _TARGET_M]),
        "size": _vector(_TARGET_M, _TARGET_M, _TARGET_M),
        "bottom_scale": 1.0,
        "top_scale": 0.5,
        "color": _colour(_TARGET),
    }


def _uncertainty(target: Json) -> Json | None:
    """Return the 2-sigma ellipse of a target, None where it has none."""
    if target["covariance"] is None:
        return None
    return _loop(_ellipse(target["position"], target["covariance"], _SIGMAS, 0.0), _TARGET)


def _zones(snapshot: Json) -> list[Json]:
    known = {zone["id"] for zone in snapshot["zones"]}
    drawn = [
        _loop(_axes_ellipse(zone), _ZONE_COLOURS[zone["kind"]])
        for zone in snapshot["zones"]
        if zone["mean"] is not None
    ]
    truth = snapshot["truth"] or {"zones": []}
    hidden = [
        _loop(_ellipse(zone["mean"], zone["covariance"], 1.0, 0.0), _UNDISCOVERED)
        for zone in truth["zones"]
        if zone["id"] not in known
    ]
    return drawn + hidden


def _assignment(snapshot: Json, robots: list[Json], targets: list[Json]) -> list[Json]:
    places = {target["id"]: target["position"] for target in targets}
    assignment = snapshot["directives"]["assignment"]
    return [
        _line([_vector(*robot["position"]), _vector(*places[target_id][:2], 0.0)], _ASSIGNED)
        for robot in robots
        for target_id in assignment.get(str(robot["id"]), ())
        if target_id in places
    ]


def _name(one: Json, letter: str) -> Json:
    x, y, *rest = one["position"]
    height = rest[0] if rest else 0.0
    return {
        "pose": _pose([x, y, height + 0.35]),
        "billboard": True,
        "font_size": 12.0,
        "scale_invariant": True,
        "color": _colour((0.1, 0.1, 0.1, 1.0)),
        "text": f"{letter}{one['id']}",
    }


def _axes_ellipse(zone: Json) -> list[Json]:
    """Return the rim within which a known zone repels, from its axes along its covariance."""
    _, axes = np.linalg.eigh(np.asarray(zone["covariance"], dtype=float))
    long, short = zone["keep_out_axes_m"]
    return _points(zone["mean"], axes @ np.diag([short, long]), 0.02)


def _ellipse(mean: list[float], covariance: Any, sigmas: float, height: float) -> list[Json]:
    values, axes = np.linalg.eigh(np.asarray(covariance, dtype=float))
    radii = sigmas * np.sqrt(np.maximum(values, 0.0))
    return _points(mean, axes @ np.diag(radii), height)


def _points(mean: list[float], shape: Any, height: float) -> list[Json]:
    angles = np.linspace(0.0, 2.0 * math.pi, _CORNERS, endpoint=False)
    rim = np.asarray(mean) + np.stack([np.cos(angles), np.sin(angles)], axis=1) @ shape.T
    return [_vector(float(x), float(y), height) for x, y in np.round(rim, 3)]


def _loop(points: list[Json], colour: tuple[float, ...]) -> Json:
    return _line(points, colour) | {"type": _LINE_LOOP}


def _line(points: list[Json], colour: tuple[float, ...]) -> Json:
    return {
        "type": _LINE_STRIP,
        "pose": _pose([0.0, 0.0, 0.0]),
        "thickness": 2.0,
        "scale_invariant": True,
        "points": points,
        "color": _colour(colour),
        "colors": [],
        "indices": [],
    }


def _pose(position: list[float]) -> Json:
    return {
        "position": _vector(*position),
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }


def _vector(*xyz: float) -> Json:
    return dict(zip("xyz", xyz, strict=True))


def _colour(rgba: tuple[float, ...]) -> Json:
    return dict(zip("rgba", rgba, strict=True))
