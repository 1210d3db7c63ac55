"""The mock's weights: moderate steps for a reason, always inside the bounds it was told."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from llm.mock.comment_rules import Wish, WishKind
from llm.mock.comment_text import wishes
from llm.mock.deciding import (
    FOREIGN_WORDS,
    NAMES,
    ActionDecision,
    Reaction,
    combined,
    unclear_words,
    unknown_words,
)
from llm.mock.explaining import NEAR_ZONE_M, explain, stands_still
from llm.mock.reading import Reading, SeenZone

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


_FACTORS: dict[WishKind, tuple[tuple[int, float], ...]] = {
    # Tracking alone would make zones cheap beside it, and a drone that is hit tracks nothing.
    WishKind.TRACK_MORE: ((TRACKING, STEP), (SENSING, STEP), (COMMUNICATION, STEP)),
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
    WishKind.TRACK_MORE: "Tracking counts more, and safety keeps pace with it",
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
            parts = [
                Reaction(comment.label, *_react(reading, draft, wish))
                for wish in wishes(comment.text)
            ]
            reactions.append(combined(comment.label, parts))
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
        if not kinds[kind]:
            continue
        ceiling = ATTACK_REACH * _middle(reading.bounds[index]) * _eagerness(reading)
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


def _eagerness(reading: Reading) -> float:
    """Return how much more than usual tracking counts, at least 1: safety keeps pace with it."""
    return max(1.0, reading.weights[TRACKING] / _middle(reading.bounds[TRACKING]))


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
    unknown = unknown_words(reading, wish.robots, wish.targets)
    if unknown:
        return "declined", unknown
    match wish.kind:
        case WishKind.NONE:
            return "declined", "This is no guidance for how the drones should fly."
        case WishKind.FOREIGN:
            return "declined", FOREIGN_WORDS
        case WishKind.UNCLEAR:
            return "declined", unclear_words(wish.words)
        case WishKind.WEIGHT:
            return _set_weights(reading, draft, wish)
        case WishKind.SEVERITY:
            return _set_severity(reading, draft, wish)
        case WishKind.HARMLESS:
            return "declined", "Only an operator may lower the severity of a zone."
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
    granted = _granted(reading, kind)
    if granted is not None:
        return "noted", f"{_EFFECTS[kind]} since comment {granted}, which still stands."
    at_the_top = draft.weights[TRACKING] >= reading.bounds[TRACKING][1]
    if kind is WishKind.TRACK_MORE and at_the_top:
        return "declined", "Tracking is at its upper bound already."
    changed = [_scale(reading, draft, index, factor) for index, factor in _FACTORS[kind]]
    if not any(changed):
        return "declined", "The weights concerned are at their bounds already."
    words = f"{_EFFECTS[kind]}{'' if all(changed) else ', as far as the bounds allow'}."
    draft.reasons.append(words)
    return ("applied" if all(changed) else "partly_applied"), words


def _granted(reading: Reading, kind: WishKind) -> str | None:
    """Return the label of a standing comment that has brought the same about, if there is one."""
    return next(
        (
            comment.label
            for comment in reading.comments
            if comment.verdict == "applied"
            and any(wish.kind is kind for wish in wishes(comment.text))
        ),
        None,
    )


def _set_weights(reading: Reading, draft: _Draft, wish: Wish) -> tuple[str, str]:
    """Give weights the value or the change that is asked for, wholly or not at all."""
    wanted = {}
    for index in wish.weights:
        asked = wish.value
        if asked is None:
            asked = _rounded(draft.weights[index] * wish.factor)
        lower, upper = reading.bounds[index]
        if not lower <= asked <= upper:
            words = f"The weight of {NAMES[index]} must be between {lower:g} and {upper:g}"
            return "declined", f"{words}, not {asked:g}."
        wanted[index] = asked
    told = ", ".join(f"{NAMES[index]} {value:g}" for index, value in wanted.items())
    if all(draft.weights[index] == value for index, value in wanted.items()):
        return "noted", f"The weights are so already: {told}."
    for index, value in wanted.items():
        draft.weights[index] = value
    words = f"The weights are now: {told}."
    draft.reasons.append(words)
    return "applied", words


def _set_severity(reading: Reading, draft: _Draft, wish: Wish) -> tuple[str, str]:
    """Raise zones to the severity that is asked for; it may not be lowered."""
    zones, value = _zones_meant(reading, wish), wish.value or 0.0
    if not zones:
        return "declined", _no_zone_words(wish)
    if "severities" not in reading.offers:
        return "declined", "Severities cannot be changed here."
    if not 1.0 <= value <= reading.severity_upper:
        words = f"A severity must be between 1 and {reading.severity_upper:g}, not {value:g}."
        return "declined", words
    if any(value < zone.severity for zone in zones):
        return "declined", "Only an operator may lower the severity of a zone."
    raised = [zone.label for zone in zones if value > zone.severity]
    if not raised:
        return "noted", f"The severity is {value:g} already."
    draft.severities.update(dict.fromkeys(raised, value))
    words = f"The severity of {' and '.join(raised)} is raised to {value:g}."
    draft.reasons.append(words)
    return "applied", words


def _zones_meant(reading: Reading, wish: Wish) -> list[SeenZone]:
    """Return the zones a comment means: by label, by number, by kind, or all of them."""
    zones = [z for z in reading.zones if wish.zone_kind in (None, z.kind)]
    if not wish.zones:
        return zones
    return [zone for zone in zones if any(_called(zone.label, name) for name in wish.zones)]


def _no_zone_words(wish: Wish) -> str:
    kind = f"{wish.zone_kind} " if wish.zone_kind else ""
    named = f" {' or '.join(wish.zones)}" if wish.zones else ""
    return f"No {kind}zone{named} is known yet."


def _called(label: str, name: str) -> bool:
    """Return whether a zone may be called so: "s1", or "1" for its number."""
    if label.lower() == name.lower():
        return True
    digits = "".join(c for c in label if c.isdigit())
    return name.isdigit() and digits == name


def _raise_zones(
    reading: Reading, draft: _Draft, zones: Sequence[SeenZone], factor: float, wish: Wish
) -> tuple[str, str]:
    if not zones:
        return "declined", _no_zone_words(wish)
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
        robots = [r for r in reading.robots if r.free and stands_still(r)]
    if not robots:
        return "noted", "No drone stands still; the slowest moves faster than 0.05 m/s."
    reasons = [explain(reading, robot) for robot in robots]
    freed = [
        robot.id
        for robot in robots
        if robot.free and "replan" in reading.offers and stands_still(robot)
    ]
    if freed:
        names = " and ".join(f"Drone {robot_id}" for robot_id in freed)
        reasons.append(f"{names} {'is' if len(freed) == 1 else 'are'} planned afresh.")
        if not set(freed) <= set(draft.replan):
            draft.reasons.append(reasons[-1])
    # Two comments may be about the same robot; it is planned afresh once.
    draft.replan = list(dict.fromkeys((*draft.replan, *freed)))
    return ("applied" if freed else "noted"), " ".join(reasons)
