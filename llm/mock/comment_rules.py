"""What a human supervisor may mean. One sentence, a few rules, no model.

The three kinds of the paper (section III-E): how well the team performs, what is dangerous,
what is abnormal. What fits no rule, or tries to give orders to the model itself, is no
guidance and gets declined.
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

    TARGET_IN_ZONE = "target_in_zone"
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


_IDS = r"(\d+(?:\s*(?:,\s*and|,|and|&|or)\s*\d+)*)"
_ROBOTS = re.compile(rf"\b(?:drones?|robots?|uavs?|quadrotors?)\s*#?\s*{_IDS}", re.I)
_TARGETS = re.compile(rf"\btargets?\s*#?\s*{_IDS}", re.I)
_ZONES = re.compile(
    r"\b(?:zones?|regions?|areas?)\s+(?:#|number\s+)?([a-z]*-?\d\w*(?:[.-]\w+)*)", re.I
)
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
_ROBOT = r"\b(?:drones?|robots?|uavs?)\s*#?\s*\d+"
_TARGET = r"\btargets?\s*#?\s*\d+"
_GIVES_UP = r"(?:\b(?:not|stop|no longer|avoid|release|drop|leave|quit)|n't)\b"
_PLACE = r"\b(?:zone|region|area)"
_COUNT = r"(?:\d+|one|two|three|four|no)\s+targets?"

_ALTERNATIVES: dict[WishKind, tuple[str, ...]] = {
    # In the order they are tried: the particular before the general.
    WishKind.STUCK: (
        r"\bstuck\b|\btrapped\b|\bblocked\b|\bfrozen\b|local minim|\bstands?\s+still",
        r"(?:\bnot|n't)\s+mov\w*|\bhover\w*\s+in place",
    ),
    WishKind.SEVERE: (
        r"\bmore\s+(?:severe|dangerous|damag\w+|harm\w*|serious|hazardous)|\bseverer\b",
        r"\bworse\s+than|\bstronger\s+than|\bunderestimat|\b(?:severe|serious)\s+(?:damage|harm)",
    ),
    WishKind.TARGET_IN_ZONE: (
        rf"{_TARGET}.{{0,30}}\b(?:in|inside|near|close to|entering|within)\b.{{0,30}}{_PLACE}",
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
    """Return what a comment asks for."""
    if _INJECTION.search(text):
        return Wish(WishKind.NONE)
    kind = next((kind for kind, rule in _RULES if rule.search(text)), WishKind.NONE)
    if kind is WishKind.NONE:
        return Wish(WishKind.NONE)
    said = _NUMBER.search(text)
    word = said.group(1).lower() if said else ""
    return Wish(
        kind=kind,
        robots=_ids(_ROBOTS, text),
        targets=_ids(_TARGETS, text),
        zones=tuple(dict.fromkeys(_ZONES.findall(text))),
        zone_kind=_zone_kind(text),
        number=(_WORDS[word] if word in _WORDS else int(word)) if word else None,
    )


def _ids(pattern: re.Pattern[str], text: str) -> tuple[int, ...]:
    found = [int(d[:9]) for m in pattern.finditer(text) for d in re.findall(r"\d+", m[1])]
    return tuple(dict.fromkeys(found))


def _zone_kind(text: str) -> str | None:
    kinds = {
        "sensing" if match[1].lower().startswith("sens") else "communication"
        for match in _KIND.finditer(text)
    }
    return kinds.pop() if len(kinds) == 1 else None
