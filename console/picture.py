"""From a snapshot message to what the scene shows: plain arrays, no viser in sight."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from console.shapes import Floats, ellipses, headings, level

Colour = tuple[int, int, int]
Json = dict[str, Any]

# Middle tones: the same scene stands before a light and a dark page.
FLYING: Colour = (104, 132, 158)
BLIND: Colour = (214, 74, 62)
JAMMED: Colour = (66, 122, 222)
LOST: Colour = (126, 126, 126)
TARGET: Colour = (30, 154, 132)
COASTING: Colour = (208, 146, 38)
SENSING: Colour = (206, 66, 56)
COMMUNICATION: Colour = (58, 112, 214)
UNDISCOVERED: Colour = (128, 132, 138)
WAYPOINT: Colour = (104, 132, 158)
TRUTH: Colour = (150, 150, 150)
FIELD: Colour = (122, 130, 138)

ZONE_COLOURS = {"sensing": SENSING, "communication": COMMUNICATION}
TRAIL_S = 12.0
TRAIL_STEP_S = 0.4
MAX_LABELS = 100
"""More would hide the scene and cost a message each."""


@dataclass(slots=True)
class SignData:
    """Poses, sizes and colours of N signs."""

    positions: Floats
    wxyzs: Floats
    scales: Floats
    colours: list[Colour]


@dataclass(slots=True)
class LineData:
    """Ends (N, 2, 3) and colours of N lines."""

    points: Floats
    colours: list[Colour]


Label = tuple[str, tuple[float, float, float]]


@dataclass(slots=True)
class Trails:
    """Where each robot was in the last seconds."""

    _points: dict[int, deque[tuple[float, float, float]]] = field(default_factory=dict)
    _last_s: float = -np.inf

    def note(self, snapshot: Json) -> None:
        """Take the robots' places if the last ones are old enough; time going back clears."""
        now_s = snapshot["time_s"]
        if now_s < self._last_s:
            self._points.clear()
            self._last_s = -np.inf
        if now_s - self._last_s < TRAIL_STEP_S - 1e-6:
            return
        self._last_s = now_s
        length = round(TRAIL_S / TRAIL_STEP_S)
        for robot in snapshot["robots"]:
            if robot["position"] is not None:
                trail = self._points.setdefault(robot["id"], deque(maxlen=length))
                trail.append(tuple(robot["position"]))

    def lines(self) -> LineData:
        """Return the trails as segments."""
        segments = [
            pair
            for trail in self._points.values()
            for pair in zip(list(trail)[:-1], list(trail)[1:], strict=True)
        ]
        points = np.array(segments, dtype=float).reshape(-1, 2, 3)
        return LineData(points, [FLYING] * len(points))


def robot_colour(robot: Json) -> Colour:
    """Return a robot's colour: its worst state."""
    if robot["link"] == "lost":
        return LOST
    if robot["link"] == "jammed":
        return JAMMED
    return BLIND if robot["sensing_failed"] else FLYING


def robot_state(robot: Json) -> str:
    """Return a robot's state in a word or two."""
    words = [] if robot["link"] == "connected" else [robot["link"]]
    if robot["sensing_failed"]:
        words.append("blind")
    return ", ".join(words) or "ok"


def sign_scale(snapshot: Json) -> float:
    """Return the size of a robot's sign, metres: readable however large the field is."""
    lower, upper = (np.asarray(snapshot["field"][key]) for key in ("lower", "upper"))
    return float(np.clip(0.032 * np.linalg.norm(upper - lower), 0.3, 60.0))


def robots(snapshot: Json) -> SignData:
    """Return the robots, turned the way they fly."""
    seen = _placed(snapshot["robots"])
    positions = np.array([r["position"] for r in seen], dtype=float).reshape(-1, 3)
    velocities = np.array([r["velocity"] or (0, 0) for r in seen], dtype=float).reshape(-1, 2)
    size = sign_scale(snapshot)
    return SignData(
        positions,
        headings(np.arctan2(velocities[:, 1], velocities[:, 0])),
        np.full((len(seen), 3), size),
        [robot_colour(r) for r in seen],
    )


def failures(snapshot: Json) -> SignData:
    """Return a ring around every robot that is not well."""
    ill = [r for r in _placed(snapshot["robots"]) if robot_state(r) != "ok"]
    positions = np.array([r["position"] for r in ill], dtype=float).reshape(-1, 3)
    return SignData(
        positions,
        level(len(ill)),
        np.full((len(ill), 3), 0.85 * sign_scale(snapshot)),
        [robot_colour(r) for r in ill],
    )


def stalks(snapshot: Json) -> LineData:
    """Return a line from each robot down to the ground, so that its height can be read."""
    seen = _placed(snapshot["robots"])
    tops = np.array([r["position"] for r in seen], dtype=float).reshape(-1, 3)
    feet = tops * (1.0, 1.0, 0.0)
    return LineData(np.stack([tops, feet], axis=1), [robot_colour(r) for r in seen])


def waypoints(snapshot: Json) -> SignData:
    """Return the way-points of the robots that are flown."""
    flown = [r for r in snapshot["robots"] if r["link"] == "connected" and r["waypoint"]]
    positions = np.array([r["waypoint"] for r in flown], dtype=float).reshape(-1, 3)
    size = 0.13 * sign_scale(snapshot)
    return SignData(
        positions, level(len(flown)), np.full((len(flown), 3), size), [WAYPOINT] * len(flown)
    )


def targets(snapshot: Json) -> SignData:
    """Return the targets on the ground."""
    seen = _placed(snapshot["targets"])
    size = 0.22 * sign_scale(snapshot)
    positions = _on_ground([t["position"] for t in seen], size)
    return SignData(
        positions,
        level(len(seen)),
        np.full((len(seen), 3), size),
        [_target_colour(t) for t in seen],
    )


def uncertainties(snapshot: Json) -> SignData:
    """Return the targets' 2-sigma ellipses."""
    seen = [t for t in _placed(snapshot["targets"]) if t["covariance"] is not None]
    axes, angles = ellipses([t["covariance"] for t in seen])
    size = 0.1 * sign_scale(snapshot)
    scales = np.column_stack([np.maximum(axes, size), np.ones(len(seen))])
    return SignData(
        _on_ground([t["position"] for t in seen], 0.03),
        headings(angles),
        scales,
        [_target_colour(t) for t in seen],
    )


def assignment_lines(snapshot: Json) -> LineData:
    """Return a line from every robot to each of its targets."""
    places = {t["id"]: t["position"] for t in _placed(snapshot["targets"])}
    points, colours = [], []
    for robot in _placed(snapshot["robots"]):
        for target_id in snapshot["directives"]["assignment"].get(str(robot["id"]), ()):
            if target_id in places:
                points.append([robot["position"], [*places[target_id], 0.05]])
                colours.append(TARGET if robot_state(robot) == "ok" else robot_colour(robot))
    return LineData(np.array(points, dtype=float).reshape(-1, 2, 3), colours)


def zones(snapshot: Json) -> SignData:
    """Return the known zones as discs out to where they repel."""
    known = snapshot["zones"]
    _, angles = ellipses([z["covariance"] for z in known])
    axes = np.array([z["keep_out_axes_m"] for z in known], dtype=float).reshape(-1, 2)
    return SignData(
        _on_ground([z["mean"] for z in known], 0.02),
        headings(angles),
        np.column_stack([axes, np.ones(len(known))]),
        [ZONE_COLOURS[z["kind"]] for z in known],
    )


def undiscovered(snapshot: Json) -> SignData:
    """Return the zones of a simulated world that nobody knows yet, out to 2 sigma."""
    known = {z["id"] for z in snapshot["zones"]}
    truth = snapshot["truth"] or {"zones": []}
    hidden = [z for z in truth["zones"] if z["id"] not in known]
    axes, angles = ellipses([z["covariance"] for z in hidden])
    return SignData(
        _on_ground([z["mean"] for z in hidden], 0.015),
        headings(angles),
        np.column_stack([axes, np.ones(len(hidden))]),
        [UNDISCOVERED] * len(hidden),
    )


def true_targets(snapshot: Json) -> SignData:
    """Return where a simulated world's targets really are."""
    truth = snapshot["truth"] or {"targets": []}
    seen = _placed(truth["targets"])
    size = 0.1 * sign_scale(snapshot)
    return SignData(
        _on_ground([t["position"] for t in seen], size),
        level(len(seen)),
        np.full((len(seen), 3), size),
        [TRUTH] * len(seen),
    )


def labels(snapshot: Json) -> dict[str, Label]:
    """Return words for robots, targets and known zones; none where there are too many."""
    found: dict[str, Label] = {}
    lift = 0.6 * sign_scale(snapshot)
    for robot in _placed(snapshot["robots"]):
        x, y, z = robot["position"]
        state = robot_state(robot)
        name = f"D{robot['id']}"
        text = name if state == "ok" else f"{name} {state}"
        found[f"r{robot['id']}"] = (text, (x, y, z + lift))
    for target in _placed(snapshot["targets"]):
        x, y = target["position"]
        found[f"t{target['id']}"] = (f"T{target['id']}", (x, y, 0.7 * lift))
    for zone in snapshot["zones"]:
        x, y = zone["mean"]
        found[f"z{zone['id']}"] = (zone["id"], (x, y, 0.1))
    return found if len(found) <= MAX_LABELS else {}


def field_grid(snapshot: Json) -> LineData:
    """Return the field's border and a grid of round metres in it."""
    (x0, y0), (x1, y1) = snapshot["field"]["lower"], snapshot["field"]["upper"]
    step = _round_step(max(x1 - x0, y1 - y0) / 12.0)
    xs = [x0, *np.arange(np.ceil(x0 / step) * step, x1, step), x1]
    ys = [y0, *np.arange(np.ceil(y0 / step) * step, y1, step), y1]
    points = [[(x, y0, 0.0), (x, y1, 0.0)] for x in xs]
    points += [[(x0, y, 0.0), (x1, y, 0.0)] for y in ys]
    return LineData(np.array(points, dtype=float), [FIELD] * len(points))


Point3 = tuple[float, float, float]


def camera(snapshot: Json) -> tuple[Point3, Point3]:
    """Return where a new viewer stands and what it looks at: from the south, from above."""
    (x0, y0), (x1, y1) = snapshot["field"]["lower"], snapshot["field"]["upper"]
    x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
    away = max(0.54 * (x1 - x0), 0.84 * (y1 - y0))
    aim = y - 0.06 * (y1 - y0)
    return (x, aim - 0.72 * away, 0.92 * away), (x, aim, 0.0)


def _round_step(length: float) -> float:
    """Return the nearest of 1, 2, 5 times a power of ten at or above a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= length))


def _placed(things: Iterable[Json]) -> list[Json]:
    return [thing for thing in things if thing["position"] is not None]


def _on_ground(places: list[Any], height: float) -> Floats:
    flat = np.array(places, dtype=float).reshape(-1, 2)
    return np.column_stack([flat, np.full(len(flat), height)])


def _target_colour(target: Json) -> Colour:
    return TARGET if target["status"] == "tracked" else COASTING
