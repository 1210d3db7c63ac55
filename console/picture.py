"""From a snapshot message to what the scene shows: plain arrays, no viser in sight."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from console.clouds import SHELL_OPACITY, SHELLS, cloud_shells, is_inferred, percent
from console.labels import Label
from console.shapes import Floats, ellipses, headings, level

Colour = tuple[int, int, int]
Point3 = tuple[float, float, float]
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
WAYPOINT: Colour = (150, 96, 190)
TRUTH: Colour = (150, 150, 150)
FIELD: Colour = (122, 130, 138)
LEADER: Colour = (122, 130, 138)

ZONE_COLOURS = {"sensing": SENSING, "communication": COMMUNICATION}
TRAIL_S = 12.0
TRAIL_STEP_S = 0.4
TRAIL_GAP_S = 5.0
"""Places farther apart in time are not joined: nobody knows the way between."""
AHEAD_S = 6.0
"""So far ahead the path of a target is shown."""

DASHES = 6


@dataclass(slots=True)
class SignData:
    """Poses, sizes and colours of N signs."""

    positions: Floats
    wxyzs: Floats
    scales: Floats
    colours: list[Colour]
    opacities: list[float] | None = None
    """Each sign's own, where it is not that of all."""


@dataclass(slots=True)
class LineData:
    """Ends (N, 2, 3) and colours of N lines."""

    points: Floats
    colours: list[Colour]


@dataclass(slots=True)
class Trails:
    """Where each robot was in the last seconds."""

    _points: dict[int, deque[tuple[float, float, float]]] = field(default_factory=dict)
    _last_s: float = -np.inf

    def note(self, snapshot: Json) -> None:
        """Take the robots' places if the last ones are old enough; a jump in time clears."""
        now_s = snapshot["time_s"]
        if now_s < self._last_s or now_s > self._last_s + TRAIL_GAP_S:
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
    flown = _flown(snapshot)
    positions = np.array([r["waypoint"] for r in flown], dtype=float).reshape(-1, 3)
    size = 0.26 * sign_scale(snapshot)
    return SignData(
        positions, level(len(flown)), np.full((len(flown), 3), size), [WAYPOINT] * len(flown)
    )


def waypoint_lines(snapshot: Json) -> LineData:
    """Return a line from each robot that is flown to its way-point."""
    flown = [r for r in _flown(snapshot) if r["position"] is not None]
    ends = np.array([[r["position"], r["waypoint"]] for r in flown], dtype=float)
    return LineData(ends.reshape(-1, 2, 3), [WAYPOINT] * len(flown))


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


def predicted_paths(snapshot: Json) -> LineData:
    """Return where the targets go if they keep their estimated velocity, as dashes."""
    seen = [t for t in _placed(snapshot["targets"]) if t["velocity"] is not None]
    places = np.array([t["position"] for t in seen], dtype=float).reshape(-1, 2)
    reach = AHEAD_S * np.array([t["velocity"] for t in seen], dtype=float).reshape(-1, 2)
    shown = np.hypot(reach[:, 0], reach[:, 1]) > 0.3 * sign_scale(snapshot)
    shares = np.arange(DASHES)[:, None] + np.array([0.35, 1.0])  # (DASHES, 2)
    points = (
        places[shown][:, None, None, :]
        + (shares / DASHES)[None, :, :, None] * reach[shown][:, None, None, :]
    ).reshape(-1, 2, 2)
    heights = np.full((len(points), 2, 1), 0.04)
    colours = [_target_colour(t) for t, on in zip(seen, shown, strict=True) if on]
    return LineData(
        np.concatenate([points, heights], axis=2), [c for c in colours for _ in range(DASHES)]
    )


def assignment_lines(snapshot: Json) -> LineData:
    """Return a line from every robot to each of its targets that is not pinned."""
    return _pair_lines(snapshot, _assigned(snapshot) - _pinned(snapshot))


def pinned_lines(snapshot: Json) -> LineData:
    """Return a line for every assigned pair that a person keeps together."""
    return _pair_lines(snapshot, _assigned(snapshot) & _pinned(snapshot))


def pins(snapshot: Json) -> SignData:
    """Return a mark in the middle of each line that is pinned."""
    lines = pinned_lines(snapshot)
    size = 0.16 * sign_scale(snapshot)
    return SignData(
        lines.points.mean(axis=1),
        level(len(lines.points)),
        np.full((len(lines.points), 3), size),
        lines.colours,
    )


def zones(snapshot: Json) -> SignData:
    """Return the zones that are known for certain as discs out to where they repel."""
    known = [z for z in snapshot["zones"] if not is_inferred(z)]
    _, angles = ellipses([z["covariance"] for z in known])
    axes = np.array([z["keep_out_axes_m"] for z in known], dtype=float).reshape(-1, 2)
    return SignData(
        _on_ground([z["mean"] for z in known], 0.02),
        headings(angles),
        np.column_stack([axes, np.ones(len(known))]),
        [ZONE_COLOURS[z["kind"]] for z in known],
    )


def clouds(snapshot: Json) -> SignData:
    """Return the inferred zones as clouds, the denser the surer (`console.clouds`)."""
    found = [z for z in snapshot["zones"] if is_inferred(z)]
    positions, wxyzs, scales = cloud_shells(found)
    return SignData(
        positions,
        wxyzs,
        scales,
        [ZONE_COLOURS[z["kind"]] for z in found for _ in range(SHELLS)],
        [SHELL_OPACITY * z["confidence"] for z in found for _ in range(SHELLS)],
    )


def undiscovered(snapshot: Json) -> SignData:
    """Return the zones of a simulated world that nobody has been shown, out to 2 sigma."""
    known = {z["id"] for z in snapshot["zones"] if not is_inferred(z)}
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


def leader_lines(ends: list[tuple[Point3, Point3]]) -> LineData:
    """Return the thin lines that lead to labels which stand away from their things."""
    return LineData(np.array(ends, dtype=float).reshape(-1, 2, 3), [LEADER] * len(ends))


def labels(snapshot: Json) -> list[Label]:
    """Return the names of robots, targets and known zones, each where its thing is."""
    found = []
    for robot in _placed(snapshot["robots"]):
        state = robot_state(robot)
        name = f"D{robot['id']}"
        text, rank = (name, 1) if state == "ok" else (f"{name} {state}", 0)
        found.append(Label(f"r{robot['id']}", text, tuple(robot["position"]), rank))
    for target in _placed(snapshot["targets"]):
        x, y = target["position"]
        found.append(Label(f"t{target['id']}", f"T{target['id']}", (x, y, 0.1), 2))
    for zone in snapshot["zones"]:
        x, y = zone["mean"]
        sure = f" {percent(zone['confidence'])}" if is_inferred(zone) else ""
        found.append(Label(f"z{zone['id']}", f"{zone['id']}{sure}", (x, y, 0.05), 3))
    return found


def field_grid(snapshot: Json) -> LineData:
    """Return the field's border and a grid of round metres in it."""
    (x0, y0), (x1, y1) = snapshot["field"]["lower"], snapshot["field"]["upper"]
    step = _round_step(max(x1 - x0, y1 - y0) / 12.0)
    xs = [x0, *np.arange(np.ceil(x0 / step) * step, x1, step), x1]
    ys = [y0, *np.arange(np.ceil(y0 / step) * step, y1, step), y1]
    points = [[(x, y0, 0.0), (x, y1, 0.0)] for x in xs]
    points += [[(x0, y, 0.0), (x1, y, 0.0)] for y in ys]
    return LineData(np.array(points, dtype=float), [FIELD] * len(points))


def _round_step(length: float) -> float:
    """Return the nearest of 1, 2, 5 times a power of ten at or above a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= length))


def team_centre(snapshot: Json) -> tuple[float, float] | None:
    """Return the middle of the robots' places, None while none is known."""
    places = [robot["position"][:2] for robot in _placed(snapshot["robots"])]
    if not places:
        return None
    x, y = np.mean(np.array(places, dtype=float), axis=0)
    return float(x), float(y)


def _flown(snapshot: Json) -> list[Json]:
    return [r for r in snapshot["robots"] if r["link"] == "connected" and r["waypoint"]]


def _assigned(snapshot: Json) -> set[tuple[int, int]]:
    assignment = snapshot["directives"]["assignment"]
    return {(int(robot), target) for robot, targets in assignment.items() for target in targets}


def _pinned(snapshot: Json) -> set[tuple[int, int]]:
    pins = snapshot["directives"]["pins"]
    return {(pin["robot"], pin["target"]) for pin in pins if not pin["forbids"]}


def _pair_lines(snapshot: Json, pairs: set[tuple[int, int]]) -> LineData:
    """Return a line for each pair whose places are known, in the colour of the robot's state."""
    places = {t["id"]: t["position"] for t in _placed(snapshot["targets"])}
    robots = {r["id"]: r for r in _placed(snapshot["robots"])}
    points, colours = [], []
    for robot_id, target_id in sorted(pairs):
        if robot_id in robots and target_id in places:
            robot = robots[robot_id]
            points.append([robot["position"], [*places[target_id], 0.05]])
            colours.append(TARGET if robot_state(robot) == "ok" else robot_colour(robot))
    return LineData(np.array(points, dtype=float).reshape(-1, 2, 3), colours)


def _placed(things: Iterable[Json]) -> list[Json]:
    return [thing for thing in things if thing["position"] is not None]


def _on_ground(places: list[Any], height: float) -> Floats:
    flat = np.array(places, dtype=float).reshape(-1, 2)
    return np.column_stack([flat, np.full(len(flat), height)])


def _target_colour(target: Json) -> Colour:
    return TARGET if target["status"] == "tracked" else COASTING
