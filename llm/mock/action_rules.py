"""The mock's weights: moderate steps for a reason, always inside the bounds it was told."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from llm.mock.comment_rules import Wish, WishKind, understand
from llm.mock.deciding import ActionDecision, Reaction
from llm.mock.reading import Reading, SeenRobot, SeenTarget, SeenZone

TRACKING, CONTROL, SENSING, COMMUNICATION = range(4)
_SAFETY = {"sensing": SENSING, "communication": COMMUNICATION}

STEP = 2.0
"""Factor on a weight that a comment asks for."""

ATTACK_STEP = 1.5
ATTACK_REACH = 4.0
"""Attacks alone raise a safety weight to at most so many times its middle."""

GROWTH = 1.3
"""A trace grown by this factor over the history asks for more tracking."""

SEVERITY_STEP = 1.5
MANY_HITS = 3
"""Hits by one zone in the recent results that make it worse than modelled."""

ATTACK_SEVERITY = 2.0
"""Attacks alone raise a severity to at most this."""

NEAR_ZONE_M = 1.0
STILL_M_S = 0.05

_FACTORS: dict[WishKind, tuple[tuple[int, float], ...]] = {
    WishKind.TRACK_MORE: ((TRACKING, STEP),),
    WishKind.AGGRESSIVE: (
        (TRACKING, STEP),
        (CONTROL, 1.0 / STEP),
        (SENSING, 1.0 / STEP),
        (COMMUNICATION, 1.0 / STEP),
    ),
    WishKind.CONSERVATIVE: ((SENSING, STEP), (COMMUNICATION, STEP)),
    WishKind.SAVE_ENERGY: ((CONTROL, STEP),),
}
_EFFECTS = {
    WishKind.TRACK_MORE: "Tracking counts more",
    WishKind.AGGRESSIVE: "Tracking counts more, control and safety less",
    WishKind.CONSERVATIVE: "Both kinds of safety count more",
    WishKind.SAVE_ENERGY: "Control effort counts more, so the drones fly more calmly",
}


@dataclass(slots=True)
class _Draft:
    """What is being decided."""

    weights: list[float]
    severities: dict[str, float] = field(default_factory=dict)
    replan: list[int] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)


def decide(reading: Reading) -> ActionDecision:
    """Return weights for an action prompt."""
    draft = _Draft(list(reading.weights))
    reactions = []
    for comment in reading.comments:
        if comment.new:
            verdict, reason = _react(reading, draft, understand(comment.text))
            reactions.append(Reaction(comment.label, verdict, reason))
    if not any(comment.new for comment in reading.comments):
        _from_attacks(reading, draft)
        _from_trace(reading, draft)
    changed = [
        weight != before for weight, before in zip(draft.weights, reading.weights, strict=True)
    ]
    if any(changed) or draft.severities or draft.replan:
        feedback = " ".join(draft.reasons)
    else:
        feedback = "The weights stay: nothing calls for a change."
    return ActionDecision(
        weights=tuple(draft.weights),
        feedback=feedback,
        reactions=tuple(reactions),
        severities=tuple(draft.severities.items()),
        replan=tuple(draft.replan),
    )


# ---------------------------------------------------------------------------- no comment


def _from_attacks(reading: Reading, draft: _Draft) -> None:
    kinds = Counter(attack.kind for attack in reading.attacks)
    for kind, index in _SAFETY.items():
        if not kinds[kind] or index >= len(reading.bounds):
            continue
        ceiling = ATTACK_REACH * _middle(reading.bounds[index])
        if draft.weights[index] < ceiling:
            _scale(reading, draft, index, ATTACK_STEP, ceiling)
            draft.reasons.append(f"A {kind} attack: {kind} safety counts more.")
    if "severities" not in reading.offers:
        return
    hits = Counter(
        attack.zone for attack in (*reading.past_attacks, *reading.attacks) if attack.zone
    )
    fresh = {attack.zone for attack in reading.attacks}
    for zone in reading.zones:
        if zone.label in fresh and hits[zone.label] >= MANY_HITS:
            raised = min(ATTACK_SEVERITY, reading.severity_upper, zone.severity * SEVERITY_STEP)
            if raised > zone.severity:
                draft.severities[zone.label] = _rounded(raised)
                draft.reasons.append(
                    f"{hits[zone.label]} attacks by zone {zone.label}: its severity is raised "
                    f"to {_rounded(raised):g}."
                )


def _from_trace(reading: Reading, draft: _Draft) -> None:
    if reading.attacks or reading.trace is None or len(reading.past_traces) < 2:
        return
    first = reading.past_traces[0]
    rising = all(
        later >= earlier
        for earlier, later in zip(reading.past_traces, reading.past_traces[1:], strict=False)
    )
    if rising and first > 0.0 and reading.trace > GROWTH * first:
        ceiling = ATTACK_REACH * _middle(reading.bounds[TRACKING])
        if draft.weights[TRACKING] < ceiling:
            _scale(reading, draft, TRACKING, ATTACK_STEP, ceiling)
            draft.reasons.append("The trace keeps growing: tracking counts more.")


def _middle(bounds: tuple[float, float]) -> float:
    return math.sqrt(bounds[0] * bounds[1])


def _scale(
    reading: Reading, draft: _Draft, index: int, factor: float, ceiling: float = math.inf
) -> bool:
    """Multiply a weight within its bounds; return whether that changed it."""
    lower, upper = reading.bounds[index]
    before = draft.weights[index]
    scaled = min(_rounded(before * factor), ceiling)
    draft.weights[index] = min(max(scaled, lower), upper)
    return draft.weights[index] != before


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


# ---------------------------------------------------------------------------- comments


def _react(reading: Reading, draft: _Draft, wish: Wish) -> tuple[str, str]:
    """Do what a comment asks of the weights; return (verdict, reason)."""
    unknown = _unknown(reading, wish)
    if unknown:
        return "declined", unknown
    match wish.kind:
        case WishKind.NONE:
            return "declined", "This is no guidance for how the drones should fly."
        case WishKind.STUCK:
            return _unstick(reading, draft, wish)
        case WishKind.SEVERE | WishKind.AVOID:
            return _raise_zones(reading, draft, _zones_meant(reading, wish), STEP, wish)
        case WishKind.TARGET_IN_ZONE:
            return _guard_target(reading, draft, wish)
        case kind if kind in _FACTORS:
            return _reweigh(reading, draft, kind)
        case _:
            return "noted", "This is for the assignment; the weights stay."


def _reweigh(reading: Reading, draft: _Draft, kind: WishKind) -> tuple[str, str]:
    changed = [_scale(reading, draft, index, factor) for index, factor in _FACTORS[kind]]
    if not any(changed):
        return "declined", "The weights concerned are at their bounds already."
    words = f"{_EFFECTS[kind]}{'' if all(changed) else ', as far as the bounds allow'}."
    draft.reasons.append(words)
    return ("applied" if all(changed) else "partly_applied"), words


def _zones_meant(reading: Reading, wish: Wish) -> list[SeenZone]:
    """Return the zones a comment means: by label, by number, by kind, or all of them."""
    zones = [z for z in reading.zones if wish.zone_kind in (None, z.kind)]
    if not wish.zones:
        return zones
    return [zone for zone in zones if any(_called(zone.label, name) for name in wish.zones)]


def _called(label: str, name: str) -> bool:
    """Return whether a zone may be called so: "s1", or "1" for its number."""
    if label.lower() == name.lower():
        return True
    digits = "".join(c for c in label if c.isdigit())
    return name.isdigit() and digits == name


def _raise_zones(
    reading: Reading, draft: _Draft, zones: Sequence[SeenZone], factor: float, wish: Wish
) -> tuple[str, str]:
    kind = f"{wish.zone_kind} " if wish.zone_kind else ""
    if not zones:
        named = f" {' or '.join(wish.zones)}" if wish.zones else ""
        return "declined", f"No {kind}zone{named} is known yet."
    raised, weights = [], []
    for zone in zones:
        severity = _rounded(min(reading.severity_upper, zone.severity * factor))
        if "severities" in reading.offers and severity > zone.severity:
            draft.severities[zone.label] = severity
            raised.append(f"{zone.label} to {severity:g}")
    if not raised:
        # Without severities, or with all of them at the top, the weight can still do something.
        for zone_kind in dict.fromkeys(zone.kind for zone in zones):
            if _scale(reading, draft, _SAFETY[zone_kind], factor):
                weights.append(zone_kind)
    if raised:
        words = f"The severity is raised: {', '.join(raised)}; the drones keep farther away."
    elif weights:
        words = f"The {' and '.join(weights)} safety counts more."
    else:
        return "declined", "Severity and weight are at their upper bounds already."
    draft.reasons.append(words)
    return "applied", words


def _guard_target(reading: Reading, draft: _Draft, wish: Wish) -> tuple[str, str]:
    """Be more careful about the zone a target is in."""
    zones = _zones_meant(reading, wish)
    places = [(t, t.position) for t in reading.targets if t.id in wish.targets and t.position]
    gaps = [
        (min(math.dist(place, zone.position) for _, place in places) - zone.keep_out_m, zone)
        for zone in zones
        if places
    ]
    inside = [zone for gap, zone in gaps if gap <= 0.0]
    near = inside or [zone for gap, zone in gaps if gap < NEAR_ZONE_M]
    if near:
        return _raise_zones(reading, draft, near, SEVERITY_STEP, wish)
    name = " and ".join(f"Target {t}" for t in wish.targets) or "The target"
    closest = min(((gap, zone.label) for gap, zone in gaps), default=None)
    if closest is None:
        return "noted", f"No known zone lies near {name}; a zone can be drawn on the map."
    words = f"{name} is {closest[0]:.1f} m outside the nearest known zone, {closest[1]}"
    return "noted", f"{words}; a zone not known yet can be drawn on the map."


# ---------------------------------------------------------------------------- stuck


def _unstick(reading: Reading, draft: _Draft, wish: Wish) -> tuple[str, str]:
    """Explain why a robot does not move, from the facts told, and have it replanned."""
    robots = [r for r in reading.robots if r.id in wish.robots]
    if not robots:
        robots = [r for r in reading.robots if r.free and _speed(r) < STILL_M_S]
    if not robots:
        return "noted", "No drone stands still; the slowest moves faster than 0.05 m/s."
    reasons = []
    for robot in robots:
        reasons.append(explain(reading, robot))
        if robot.free and "replan" in reading.offers and _speed(robot) < STILL_M_S:
            draft.replan.append(robot.id)
    if draft.replan:
        names = " and ".join(f"Drone {robot_id}" for robot_id in draft.replan)
        reasons.append(f"{names} is planned afresh.")
        draft.reasons.append(reasons[-1])
    return ("applied" if draft.replan else "noted"), " ".join(reasons)


def explain(reading: Reading, robot: SeenRobot) -> str:
    """Say what a robot does and what holds it, in facts from the prompt."""
    name = f"Drone {robot.id}"
    if robot.lost:
        return f"{name} is lost."
    if robot.cut_off:
        return f"{name} is cut off by a communication failure and flies on board."
    parts = [
        f"{name} moves at {_speed(robot):.2f} m/s, commanded {math.hypot(*robot.commanded):.2f} m/s"
    ]
    if robot.blind:
        parts.append("it is in sensing failure and sees no target")
    parts.extend(_held_by(reading, robot))
    if reading.rung is not None:
        parts.append(f"the last optimization ended {reading.rung}")
    return f"{'; '.join(parts)}."


def _held_by(reading: Reading, robot: SeenRobot) -> list[str]:
    targets = {target.id: target for target in reading.targets}
    mine = [targets[t] for t in robot.row if t in targets and targets[t].position]
    parts = []
    for zone in reading.zones:
        gap = math.dist(robot.position, zone.position) - zone.keep_out_m
        if gap < NEAR_ZONE_M:
            where = f"{gap:.1f} m outside" if gap >= 0.0 else f"{-gap:.1f} m inside"
            parts.append(f"it is {where} the keep-out of {zone.kind} zone {zone.label}")
            inside = [
                f"Target {t.id}"
                for t in mine
                if t.position and math.dist(t.position, zone.position) < zone.keep_out_m
            ]
            if inside:
                parts.append(f"{' and '.join(inside)} is inside that zone")
    parts.extend(_distance_words(robot, target) for target in mine)
    if not robot.row:
        parts.append("it has no target")
    return parts


def _distance_words(robot: SeenRobot, target: SeenTarget) -> str:
    away = math.dist(robot.position, target.position or robot.position)
    return f"Target {target.id} is {away:.1f} m away"


def _speed(robot: SeenRobot) -> float:
    return math.hypot(*robot.velocity)


def _unknown(reading: Reading, wish: Wish) -> str:
    robots = [r for r in wish.robots if r not in {robot.id for robot in reading.robots}]
    targets = [t for t in wish.targets if t not in {target.id for target in reading.targets}]
    missing = [f"Drone {r}" for r in robots] + [f"Target {t}" for t in targets]
    return f"There is no {' and no '.join(missing)}." if missing else ""
