"""A comment taken apart: clauses, pronouns, other languages, orders to the model itself.

A text that tries to give the model orders is no guidance as a whole, whatever else it says.
"""

import re

from llm.mock.comment_rules import (
    Wish,
    WishKind,
    gives_orders_to_the_model,
    robots_named,
    understand,
)

MOST_CLAUSES = 8
LONGEST_WORDS = 60

_CLAUSE = re.compile(r"(?<=[.!?;])\s+|\n|;\s*")
_NEXT_ROBOT = re.compile(
    r"(\btargets?\s*#?\d{1,9}(?:\s*(?:,|and)\s*\d{1,9})*)\s*,?\s+(?:and|while)\s+"
    r"(?=(?:the\s+)?(?:drone|robot)s?\s*#?\d)",
    re.I,
)
"""Between "Drone 21 ... target 122" and "and drone 26 ..."."""

_NUMBERING = re.compile(r"^\s*(?:[-*\u2022]|\d{1,2}[.)])\s+")
_IT = re.compile(r"\b(?:it|this one|that one|he|she)\b", re.I)
_BARE = re.compile(
    r"^\s*#?(\d{1,6})\s+(should|must|has to|needs to|to)\s+(track|follow|focus on|stop tracking)"
    r"\s+#?(\d{1,6})\b",
    re.I,
)
_OUR_MATTER = re.compile(
    r"\b(?:drones?|robots?|uavs?|targets?|zones?|weights?|severit\w+|capacit\w+)\b", re.I
)
_FOREIGN_WORDS = (
    "alle auf bitte cibles das de deben debe deve devono di die doit doivent dron drohne drohnen "
    "een eine einen el en est et gli het il ist la las le les los mehr nicht niet non obiettivi "
    "para pas perche perch\u00e9 plus por pourquoi que roboter soll sollen sind sur uma una und "
    "une waarom warum ziele n\u00e3o suivent der dans"
)
_GENERAL = frozenset(
    {
        WishKind.SPREAD,
        WishKind.TRACK_MORE,
        WishKind.AGGRESSIVE,
        WishKind.CONSERVATIVE,
        WishKind.SAVE_ENERGY,
    }
)
"""Kinds that are meant once, however often and of whomever they are said."""

_FOREIGN_SHARE = 0.3
"""Of letters outside of the Latin alphabet."""

_FOREIGN_HITS = 2


def wishes(text: str) -> tuple[Wish, ...]:
    """Return what a comment asks for, clause by clause; at least one wish, be it none."""
    if gives_orders_to_the_model(text):
        return (Wish(WishKind.NONE),)
    found: list[Wish] = []
    before: tuple[int, ...] = ()
    for clause in _clauses(text):
        named = robots_named(clause)
        if not named and len(before) == 1:
            clause = _IT.sub(f"drone {before[0]}", clause)
        before = named or before
        wish = understand(_BARE.sub(r"Drone \1 \2 \3 Target \4", clause))
        if wish.kind is WishKind.NONE and _OUR_MATTER.search(clause):
            wish = Wish(WishKind.UNCLEAR, words=clause.strip()[:LONGEST_WORDS])
        echo = wish.kind in _GENERAL and any(wish.kind is other.kind for other in found)
        if wish.kind is not WishKind.NONE and wish not in found and not echo:
            found.append(wish)
    if any(wish.kind is not WishKind.UNCLEAR for wish in found):
        return tuple(found)
    whole = understand(text)
    if whole.kind is not WishKind.NONE:
        return (whole,)
    if _foreign(text):
        return (Wish(WishKind.FOREIGN),)
    return tuple(found) or (Wish(WishKind.NONE),)


def _clauses(text: str) -> list[str]:
    parts = _CLAUSE.split(_NEXT_ROBOT.sub(r"\1; ", text))
    parts = [_NUMBERING.sub("", part).strip() for part in parts if part]
    return [part for part in parts if part][:MOST_CLAUSES]


def _foreign(text: str) -> bool:
    letters = [c for c in text if c.isalpha()]
    exotic = sum(not c.isascii() for c in letters)
    if letters and exotic > _FOREIGN_SHARE * len(letters):
        return True
    words = set(re.findall(r"[^\W\d_]+", text.lower()))
    return len(words.intersection(_FOREIGN_WORDS.split())) >= _FOREIGN_HITS
