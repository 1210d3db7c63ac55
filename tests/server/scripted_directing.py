"""What the scripted mission does when people steer: what is asked, without any verification."""

from dataclasses import dataclass, replace
from typing import Any

from solver.directives import Directives, Pairing, Pin, Source, Weights
from solver.zones import Zone, ZoneKind

NOTHING: dict[str, Any] = {
    "assignment": [],
    "weights": {},
    "capacities": {},
    "severities": {},
    "pins_set": [],
    "pins_lifted": [],
    "replan": [],
}


@dataclass(frozen=True, slots=True)
class Steered:
    """Directives and zones after something was asked for, and what a card would call changed."""

    directives: Directives
    zones: tuple[Zone, ...]
    changes: dict[str, Any]
    zone: dict[str, Any] | None = None


def steered(
    directives: Directives, zones: tuple[Zone, ...], what: str, asked: dict[str, Any], time_s: float
) -> Steered:
    """Return what comes of one request."""
    match what:
        case "pin":
            pin = Pin(
                asked["id"],
                Pairing(asked["robot"], asked["target"]),
                None if asked.get("ttl_s") is None else time_s + asked["ttl_s"],
                None,
                asked["forbids"],
            )
            told = {
                "id": pin.id,
                "robot": pin.pair.robot_id,
                "target": pin.pair.target_id,
                "forbids": pin.forbids,
                "expires_s": pin.expires_s,
            }
            return Steered(_pinned(directives, pin), zones, NOTHING | {"pins_set": [told]})
        case "unpin":
            pins = tuple(pin for pin in directives.pins if pin.id != asked["id"])
            lifted = NOTHING | {"pins_lifted": [asked["id"]]}
            return Steered(replace(directives, pins=pins), zones, lifted)
        case "weights":
            return _weighed(directives, zones, Weights(*asked["weights"]), time_s)
        case "capacities":
            wanted = {int(robot): most for robot, most in asked["capacities"].items()}
            most = tuple((robot, wanted.get(robot, had)) for robot, had in directives.capacities)
            return Steered(replace(directives, capacities=most), zones, NOTHING)
        case "zone":
            return _drawn(directives, zones, asked)
        case "zone_change" | "zone_erase":
            return _changed(directives, zones, what, asked)
    return Steered(directives, zones, NOTHING)


def _pinned(directives: Directives, pin: Pin) -> Directives:
    pins = (*(known for known in directives.pins if known.id != pin.id), pin)
    pairs = (
        directives.assignment - {pin.pair} if pin.forbids else directives.assignment | {pin.pair}
    )
    return replace(directives, pins=pins, assignment=pairs)


def _weighed(
    directives: Directives, zones: tuple[Zone, ...], weights: Weights, time_s: float
) -> Steered:
    before = directives.weights._asdict()
    changed = {
        name: [before[name], value]
        for name, value in weights._asdict().items()
        if value != before[name]
    }
    after = replace(
        directives, weights=weights, weights_source=Source.OPERATOR, weights_since_s=time_s
    )
    return Steered(after, zones, NOTHING | {"weights": changed})


def _drawn(directives: Directives, zones: tuple[Zone, ...], asked: dict[str, Any]) -> Steered:
    number = 1
    while f"h{number}" in {zone.id for zone in zones}:
        number += 1
    margin, risk = asked.get("margin"), asked.get("risk")
    zone = Zone(
        f"h{number}",
        ZoneKind(asked["kind"]),
        (asked["mean"][0], asked["mean"][1]),
        (
            (asked["covariance"][0][0], asked["covariance"][0][1]),
            (asked["covariance"][1][0], asked["covariance"][1][1]),
        ),
        0.1 if margin is None else margin,
        0.1 if risk is None else risk,
    )
    return Steered(directives, (*zones, zone), NOTHING, told(zone))


def _changed(
    directives: Directives, zones: tuple[Zone, ...], what: str, asked: dict[str, Any]
) -> Steered:
    zone = next((known for known in zones if known.id == asked["id"]), None)
    about = {"id": asked["id"], "kind": "sensing"} if zone is None else told(zone)
    if what == "zone_erase":
        left = tuple(known for known in zones if known.id != asked["id"])
        return Steered(directives, left, NOTHING, about)
    before = dict(directives.severities)
    severity = asked.get("severity") or before.get(asked["id"], 1.0)
    changes = {asked["id"]: [before.get(asked["id"], 1.0), severity]}
    after = replace(directives, severities=tuple((before | {asked["id"]: severity}).items()))
    return Steered(after, zones, NOTHING | {"severities": changes}, about)


def told(zone: Zone) -> dict[str, Any]:
    """Return a zone as an answer tells it."""
    return {"id": zone.id, "kind": zone.kind.value, "mean": list(zone.mean)}
