"""What one clause of a human supervisor may mean. A few rules, no model.

The three kinds of the paper (section III-E): how well the team performs, what is dangerous,
what is abnormal. Whole comments are taken apart in `llm.mock.comment_text`.
"""

import re
from dataclasses import dataclass
from enum import StrEnum


class WishKind(StrEnum):
    """What a comment is about."""

    FOCUS = "focus"
    """A robot should track a target."""

    RELEASE = "release"
    """A robot should not track a target."""

    SPREAD = "spread"
    """The robots do not seem to track the targets: one robot per target."""

    CAPACITY = "capacity"
    """A robot can track so many targets only."""

    TRACK_MORE = "track_more"
    AGGRESSIVE = "aggressive"
    CONSERVATIVE = "conservative"
    SAVE_ENERGY = "save_energy"
    STUCK = "stuck"
    SEVERE = "severe"
    """Zones do more harm than assumed."""

    AVOID = "avoid"
    """Keep away from a zone."""

    HARMLESS = "harmless"
    """Zones do less harm than assumed."""

    SEVERITY = "severity"
    """A zone's severity, as a number."""

    WEIGHT = "weight"
    """A weight, as a number or up or down."""

    TARGET_IN_ZONE = "target_in_zone"
    UNCLEAR = "unclear"
    """About robots, targets or zones, and yet not understood."""

    FOREIGN = "foreign"
    """In another language."""

    NONE = "none"
    """No guidance."""


TASK_KINDS = frozenset({WishKind.FOCUS, WishKind.RELEASE, WishKind.SPREAD, WishKind.CAPACITY})
"""Wishes that the assignment can grant; the weights see to the others."""


@dataclass(frozen=True, slots=True)
class Wish:
    """One comment, understood."""

    kind: WishKind
    robots: tuple[int, ...] = ()
    targets: tuple[int, ...] = ()
    zones: tuple[str, ...] = ()
    """Zones as named: "1", "s1"."""

    zone_kind: str | None = None
    number: int | None = None
    value: float | None = None
    """What a weight or severity is to be."""

    factor: float = 1.0
    """What a weight is to be multiplied by, where no value is named."""

    weights: tuple[int, ...] = ()
    """Which weights, by their place in the paper's order."""

    everyone: bool = False
    """All robots are meant."""

    words: str = ""
    """The clause, where it was not understood."""


_IDS = r"(\d+(?:\s*(?:,\s*and|,|and|&|or)\s*\d+)*)"
_NO = r"[\s-]*(?:#|no\.?|number|id)?\s*"
_ANY_VEHICLE = (
    r"(?:drones?|robots?|uavs?|quadrotors?|quadcopters?|copters?|vehicles?|falcons?|r(?=\d))"
)
_VEHICLE = rf"\b{_ANY_VEHICLE}"
_ROBOTS = re.compile(rf"{_VEHICLE}{_NO}{_IDS}", re.I)
_TARGETS = re.compile(rf"\b(?:targets?|ground robots?){_NO}{_IDS}", re.I)
_EVERYONE = re.compile(
    rf"\b(?:all|both|every|each)\s+(?:of\s+)?(?:the\s+)?(?:\w+\s+)?{_ANY_VEHICLE}\b", re.I
)
_WEIGHT_NAMES = tuple(
    re.compile(pattern, re.I)
    for pattern in (
        r"\btrack\w*|\bw1\b",
        r"\bcontrol|\beffort|\bw2\b",
        r"\bsens\w*|\bw3\b",
        r"\bcomm\w*|\bw4\b",
    )
)
_VALUE = re.compile(r"(?:\bto|=|:|\bbe|\bat|\bis)\s*(-?\d+(?:\.\d+)?(?:e[+-]?\d+)?)", re.I)
_UP = re.compile(r"\b(?:increas|rais|higher|doubl|more|up\b)", re.I)
_DOWN = re.compile(r"\b(?:decreas|lower|reduc|halv|less|down\b)", re.I)
_ZONES = re.compile(
    r"\b(?:zones?|regions?|areas?)\s+(?:#|number\s+)?([a-z]*-?\d\w*(?:[.-]\w+)*)", re.I
)
_ZONE_TOLD = re.compile(r"\bzone\s+([\w.-]+?)\s*(?:\bto\b|=|:|\bshould\b|\bbe\b|\bis\b)", re.I)
_KIND = re.compile(r"\b(sens(?:ing|or)|comm(?:unication|s|\.)?|jamm\w*)\b", re.I)
_NUMBER = re.compile(
    r"(?:at most|only|no more than|just|up to)\s+(\d+|one|two|three|four|no)\s+targets?", re.I
)
_WORDS = {"no": 0, "one": 1, "two": 2, "three": 3, "four": 4}

_INJECTION = re.compile(
    r"\b(?:ignore|disregard|forget|override)\b.{0,40}\b(?:instruction|rule|previous|prior|above|"
    r"prompt|bound|constraint|limit|verification)|\bsystem\s*(?:prompt|message|:)|\byou are now\b"
    r"|\b(?:act|behave|pretend)\b.{0,20}\bas\b|\bjailbreak|\bdeveloper mode|\brespond only with"
    r"|\boutput (?:only|exactly)|^\s*(?:assistant|system|user)\s*:|[{}\[\]]|<[\w/|<]",
    re.I,
)
_ROBOT = rf"(?:{_VEHICLE}{_NO}\d+|{_EVERYONE.pattern})"
_TARGET = rf"\btargets?{_NO}\d+"
_GIVES_UP = r"(?:\b(?:not|stop|no longer|avoid|release|drop|leave|quit)|n't)\b"
_PLACE = r"\b(?:zone|region|area)"
_COUNT = r"(?:\d+|one|two|three|four|no)\s+targets?"

_ALTERNATIVES: dict[WishKind, tuple[str, ...]] = {
    # In the order they are tried: the particular before the general.
    WishKind.SEVERITY: (r"\bseverit(?:y|ies)\b.{0,60}(?:\bto|=|:|\bbe|\bis)\s*-?\d",),
    WishKind.WEIGHT: (r"\bweights?\b", r"\bw[1-4]\b"),
    WishKind.HARMLESS: (
        r"\bless\s+(?:severe|dangerous|damag\w+|harm\w*|serious|hazardous)|\bharmless\b",
        r"\b(?:not|n't)\s+(?:so|as|that|very)?\s*(?:severe|dangerous|bad|harmful)\b",
        r"\b(?:lower|reduce|decrease)\b.{0,30}\bseverit|\boverestimat",
    ),
    WishKind.STUCK: (
        r"\bstuck\b|\btrapped\b|\bblocked\b|\bfrozen\b|local minim|\bstands?\s+still",
        r"(?:\bnot|n't)\s+mov\w*|\bhover\w*\s+in place",
    ),
    WishKind.SEVERE: (
        r"\bmore\s+(?:severe|dangerous|damag\w+|harm\w*|serious|hazardous)|\bseverer\b",
        r"\bworse\s+than|\bstronger\s+than|\bunderestimat|\b(?:severe|serious)\s+(?:damage|harm)",
    ),
    WishKind.TARGET_IN_ZONE: (
        rf"{_TARGET}.{{0,30}}\b(?:in|inside|into|near|close to|entering|within)\b.{{0,30}}{_PLACE}",
    ),
    WishKind.AVOID: (
        rf"\b(?:avoid|(?:keep|stay|steer) (?:away|out|clear)|away from).{{0,60}}{_PLACE}",
    ),
    WishKind.CAPACITY: (rf"\b(?:at most|only|no more than|just|up to)\s+{_COUNT}",),
    WishKind.RELEASE: (rf"{_ROBOT}.{{0,40}}{_GIVES_UP}.{{0,30}}{_TARGET}",),
    WishKind.FOCUS: (rf"{_ROBOT}.{{0,60}}{_TARGET}", rf"{_TARGET}.{{0,60}}{_ROBOT}"),
    WishKind.SPREAD: (
        r"\b(?:not|never|nobody|no one|fail\w*)\b.{0,30}\b(?:track|follow|cover|monitor)\w*",
        r"n't\b.{0,30}\b(?:track|follow|cover|monitor)\w*|\bmiss(?:es|ing|ed)?\b.{0,20}\btarget",
        r"\bsame targets?\b|\bone\s+(?:drone|robot)\s+(?:per|for each)\s+target",
        r"\bspread out\b|\bsplit up\b",
    ),
    WishKind.TRACK_MORE: (
        r"\b(?:focus|concentrate|emphasi\w+|priori\w+)\b.{0,20}\b(?:track|target)\w*|\btrace\b",
        r"\btrack\w*\b.{0,30}\b(?:better|closer|more|poor|bad|not good|worse)\b|\buncertain",
        r"\b(?:better|closer|poor|bad|more)\s+(?:on\s+)?track\w*",
    ),
    WishKind.CONSERVATIVE: (
        r"\b(?:conservative|careful|cautious|safer|safety|safe|too close|too risky)\b",
        r"\b(?:less aggressive|too aggressive|fewer attacks|too many (?:attacks|hits))\b",
    ),
    WishKind.AGGRESSIVE: (r"\b(?:aggressive|bolder|bold|faster|braver|take more risk|quicker)\b",),
    WishKind.SAVE_ENERGY: (
        r"\b(?:energy|battery|batteries|power|slower|slow down|smooth\w*)\b",
        r"\bzig\s*-?zag\w*|\boscillat\w*|\bjitter\w*",
    ),
}
_RULES = tuple(
    (kind, re.compile("|".join(patterns), re.I)) for kind, patterns in _ALTERNATIVES.items()
)


def understand(text: str) -> Wish:
    """Return what one clause asks for."""
    kind = next((kind for kind, rule in _RULES if rule.search(text)), WishKind.NONE)
    if kind is WishKind.NONE:
        return Wish(WishKind.NONE)
    said = _NUMBER.search(text)
    word = said.group(1).lower() if said else ""
    value = _VALUE.search(text) if kind in (WishKind.WEIGHT, WishKind.SEVERITY) else None
    if kind is WishKind.WEIGHT and value is None and _factor(text) == 1.0:
        return Wish(WishKind.NONE)
    return Wish(
        kind=kind,
        robots=_ids(_ROBOTS, text),
        targets=_ids(_TARGETS, text),
        zones=tuple(dict.fromkeys(_ZONES.findall(text))) or _zone_told(kind, text),
        zone_kind=_zone_kind(text),
        number=(_WORDS[word] if word in _WORDS else int(word[:9])) if word else None,
        value=float(value.group(1)) if value else None,
        factor=_factor(text) if kind is WishKind.WEIGHT else 1.0,
        weights=_weights(text) if kind is WishKind.WEIGHT else (),
        everyone=bool(_EVERYONE.search(text)),
    )


def gives_orders_to_the_model(text: str) -> bool:
    """Return whether a text tries to speak to the model itself instead of guiding the team."""
    return bool(_INJECTION.search(text))


def robots_named(text: str) -> tuple[int, ...]:
    """Return the robots that a text names by their ids."""
    return _ids(_ROBOTS, text)


def _zone_told(kind: WishKind, text: str) -> tuple[str, ...]:
    """Return the zone whose severity is told, whatever it is called."""
    match = _ZONE_TOLD.search(text) if kind is WishKind.SEVERITY else None
    return (match.group(1),) if match else ()


def _factor(text: str) -> float:
    if _UP.search(text):
        return 2.0
    return 0.5 if _DOWN.search(text) else 1.0


def _weights(text: str) -> tuple[int, ...]:
    """Return which weights are meant: those named, or all."""
    return tuple(k for k, name in enumerate(_WEIGHT_NAMES) if name.search(text)) or (0, 1, 2, 3)


def _ids(pattern: re.Pattern[str], text: str) -> tuple[int, ...]:
    found = [int(d[:9]) for m in pattern.finditer(text) for d in re.findall(r"\d+", m[1])]
    return tuple(dict.fromkeys(found))


def _zone_kind(text: str) -> str | None:
    kinds = {
        "sensing" if match[1].lower().startswith("sens") else "communication"
        for match in _KIND.finditer(text)
    }
    return kinds.pop() if len(kinds) == 1 else None
