"""Sentences to say now, made from the picture: ids that exist, pairs that are within reach.

They promise nothing. What is said goes the way of every comment, and gate or verification may still
refuse it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import hypot
from typing import Final

from console.picture import robot_state
from console.render import Json

MOST: Final = 3

CLOSER: Final = 0.8
"""A robot is worth naming for another's target from this part of the other's distance on."""

STILL_M_S: Final = 0.02
"""A robot that has a target and is slower than this may be stuck."""

_SETTLED_S: Final = 5.0
"""So long after the start nobody is asked why they stand still."""


OFFERED_S: Final = 15.0
"""What is offered is made anew after so much mission time."""


@dataclass(slots=True)
class Offers:
    """The sentences that are offered, and when others take their place."""

    sentences: list[str] = field(default_factory=list)
    reached_for: bool = False
    """Whether a pointer is over them, or the keyboard among them: none moves under a finger."""

    _made_s: float | None = None
    """Mission time, None where what they were made from is over."""

    def renew(self, snapshot: Json | None) -> bool:
        """Make them anew if it is time; return whether they are others now."""
        if snapshot is None or (self.reached_for and self.sentences):
            return False
        time_s = snapshot["time_s"]
        # Time goes back where another mission, or the past of this one, is looked at.
        fresh = self._made_s is not None and 0.0 <= time_s - self._made_s < OFFERED_S
        if fresh and self.sentences:
            return False
        before, self.sentences, self._made_s = self.sentences, suggestions(snapshot), time_s
        return before != self.sentences

    def spoken(self) -> None:
        """Note that somebody has said something: what is left to say has changed."""
        self._made_s = None


def suggestions(snapshot: Json | None) -> list[str]:
    """Return sentences that make sense now, ready to be sent or changed."""
    if snapshot is None or not snapshot["robots"] or not snapshot["targets"]:
        return []
    found = [*_pair(snapshot), *_caution(snapshot), *_question(snapshot)]
    if len(found) < MOST:
        found.append("Focus more on tracking targets.")
    return found[:MOST]


def _pair(snapshot: Json) -> Iterator[str]:
    """Yield the pair that promises most: room for one more target, or a shorter way to it."""
    best = min(_pairs(snapshot), default=None)
    if best is not None:
        _, _, robot, target = best
        yield f"The Drone {robot} should focus on tracking target {target}."


def _pairs(snapshot: Json) -> Iterator[tuple[bool, float, int, int]]:
    """Yield pairs that are not assigned: whether it is a swap, distance in parts, robot, target.

    The distance is told in parts of that of the robot which has the target now.
    """
    directives = snapshot["directives"]
    trackers = _trackers(directives["assignment"])
    fit = {r["id"]: r["position"] for r in snapshot["robots"] if _fit(r)}
    forbidden = {(pin["robot"], pin["target"]) for pin in directives["pins"] if pin["forbids"]}
    for target in snapshot["targets"]:
        place = target["position"]
        if place is None or target["status"] != "tracked" or _in_a_zone(place, snapshot["zones"]):
            continue
        theirs = [_apart(fit[r], place) for r in trackers.get(target["id"], ()) if r in fit]
        for robot, own_place in fit.items():
            if robot in trackers.get(target["id"], ()) or (robot, target["id"]) in forbidden:
                continue
            part = _apart(own_place, place) / max(min(theirs, default=1.0), 1e-3)
            load = len(directives["assignment"].get(str(robot), ()))
            full = load >= directives["capacities"].get(str(robot), 1)
            if not full or part <= CLOSER:
                yield full, part, robot, target["id"]


def _caution(snapshot: Json) -> Iterator[str]:
    """Yield the zone that lies nearest to a robot, where one is known; boldness where none is."""
    places = [r["position"] for r in snapshot["robots"] if r["position"] is not None]
    zones = [zone for zone in snapshot["zones"] if zone["mean"] is not None]
    if zones and places:
        near = min(zones, key=lambda zone: min(_apart(zone["mean"], place) for place in places))
        yield f"Avoid the region around zone {near['id']}."
    elif all(map(_fit, snapshot["robots"])):
        yield "The robots should be more aggressive."


def _question(snapshot: Json) -> Iterator[str]:
    """Yield a question about what a supervisor may wonder at."""
    if snapshot["time_s"] < _SETTLED_S:
        return
    assignment = snapshot["directives"]["assignment"]
    for robot in snapshot["robots"]:
        speed_m_s = hypot(*(robot["velocity"] or (1.0, 1.0))[:2])
        if _fit(robot) and assignment.get(str(robot["id"])) and speed_m_s < STILL_M_S:
            yield f"Why does the Drone {robot['id']} get stuck?"
            return


def _trackers(assignment: Json) -> dict[int, list[int]]:
    found: dict[int, list[int]] = {}
    for robot, targets in assignment.items():
        for target in targets:
            found.setdefault(target, []).append(int(robot))
    return found


def _fit(robot: Json) -> bool:
    return robot_state(robot) == "ok" and robot["position"] is not None


def _in_a_zone(place: list[float], zones: list[Json]) -> bool:
    return any(
        zone["mean"] is not None and _apart(zone["mean"], place) < (zone["keep_out_m"] or 0.0)
        for zone in zones
    )


def _apart(a: list[float], b: list[float]) -> float:
    return hypot(a[0] - b[0], a[1] - b[1])
