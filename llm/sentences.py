"""The paper's plain lines, as models really write them.

Known: "Drone 21 should track Target 122 and Target 124.", "Targets 122 and 124", lists with
bullets or numbers, tables, "Drone 21: none", several robots in one sentence, "Target 122 is
tracked by Drone 21". Not counted: what a drone is to avoid, gives up, or merely is near to.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto

from solver.directives import Weights

Rows = tuple[tuple[int, tuple[int, ...]], ...]
"""(robot id, target ids) per robot, as said."""

_FEEDBACK = re.compile(
    r"^[ \t>*_#-]{0,20}feedback\s*(?:to|for)?\s*(?:the\s*)?(?:human)?\s*(?:supervisor|operator)?"
    r"[*_]*\s*[:\-][*_]*\s*",
    re.I | re.M,
)
_COMMENT = re.compile(
    r"^[ \t>*_#-]{0,20}comment[ \t]+([\w.-]+?)[*_]*\s*:[*_]*\s*"
    r"(applied|partly[ _]applied|partially[ _]applied|declined|noted)\b[\s,.:;-]*(.*)$",
    re.I | re.M,
)
_BULLET = re.compile(r"^[\s>|]*(?:[-*•+]\s+|\(?\d{1,3}[.)]\s+|#+\s+)?")
_MARKUP = re.compile(r"[*`]+|(?<!\w)_+|_+(?!\w)")
_SENTENCE = re.compile(r"(?<=[.!?;])\s+|\n")
_ANSWER_LINE = re.compile(
    r"^(?:the\s+)?(?:drones?|robots?|uavs?|quadrotors?)\s*(?:id\s*)?#?\d", re.I
)


@dataclass(frozen=True, slots=True)
class Said:
    """A plain answer in its parts."""

    body: str
    feedback: str
    comments: tuple[tuple[str, str, str], ...]
    """(label, verdict, reason) as written."""


def split(text: str) -> Said:
    """Separate the answer, the feedback and the answers to comments."""
    comments = tuple((m[1], m[2], m[3].strip()) for m in _COMMENT.finditer(text))
    rest = _COMMENT.sub("", text)
    match = _FEEDBACK.search(rest)
    if match is None:
        return Said(rest, "", comments)
    # A paragraph after the feedback that goes on with the answer belongs to the answer.
    feedback, *after = re.split(r"\n\s*\n", rest[match.end() :].strip(), maxsplit=1)
    later = "".join(after)
    lines = [line for line in later.splitlines() if _ANSWER_LINE.match(_bare(line))]
    return Said("\n".join([rest[: match.start()], *lines]), " ".join(feedback.split()), comments)


# ---------------------------------------------------------------------------- assignment


class _Kind(Enum):
    ROBOTS = auto()
    TARGETS = auto()
    NOBODY = auto()
    """none, no target, idle."""

    VERB = auto()
    NOT = auto()
    """avoid, not, instead of, no longer, previously."""

    TURN = auto()
    """but: what was not meant before is meant after."""

    SEPARATOR = auto()
    """Colon, arrow, bar: in a list it stands for the verb."""

    PASSIVE = auto()
    """by, to: the robots follow the targets."""

    NUMBERS = auto()


_IDS = r"#?\d{1,9}(?:\s*(?:,\s*and|,|and|&|or|/|\+)\s*#?\d{1,9}(?![\d.]*\s*(?:m|s|%)\b))*"
_TOKEN = re.compile(
    rf"(?P<ROBOTS>\b(?:drones?|robots?|uavs?|quadrotors?)\s*(?:ids?\s*)?{_IDS})"
    rf"|(?P<TARGETS>\btargets?\s*(?:ids?\s*)?[\[(]?{_IDS}[\])]?)"
    r"|(?P<NOBODY>\bnone\b|\bno\s+(?:new\s+)?targets?\b|\bnothing\b|\bidle\b|\bnot\s+assigned\b"
    r"|\bunassigned\b|\bno\s+assignment\b|\[\s*\])"
    r"|(?P<NOT>\bnot\b|n't\b|\bnever\b|\bavoid\w*|\bignor\w*|\binstead\s+of\b|\brather\s+than\b"
    r"|\bno\s+longer\b|\bstop\w*|\bexcept\b|\bwithout\b|\breleas\w*|\bhand(?:s|ed|ing)?\s+over\b"
    r"|\bdrop\w*|\bleav\w*|\bfrom\b|\bpreviously\b|\bformerly\b|\bcurrently\b|\bwas\s+tracking\b"
    r"|\bwere\s+tracking\b|\bhad\b|\bused\s+to\b|\bwhile\s+target)"
    r"|(?P<TURN>\bbut\b|\binstead\b|\bnow\b)"
    r"|(?P<VERB>\btrack\w*|\bfollow\w*|\bmonitor\w*|\bcover\w*|\bassign\w*|\bfocus\w*"
    r"|\bobserv\w*|\bwatch\w*|\btak(?:e|es|ing)\b|\bhandl\w*|\bkeep\w*|\bget(?:s|ting)?\b"
    r"|\bswitch\w*|\bpursu\w*|\balso\b|\bresponsible\b)"
    r"|(?P<PASSIVE>\bby\b|\bto\b)"
    r"|(?P<SEPARATOR>:|->|→|=>|=|\||–|—|\s-\s)"
    rf"|(?P<NUMBERS>[\[(]?\b{_IDS}[\])]?)",
    re.I,
)


@dataclass(slots=True)
class _Reader:
    """Reads one sentence from left to right."""

    robots: tuple[int, ...] = ()
    pending: tuple[int, ...] = ()
    """Targets named before any robot: "Target 122 is tracked by Drone 21"."""

    meant: bool = True
    asked: bool = False
    """A verb or separator stands between the robot and what follows."""

    passive: bool = False
    last: _Kind | None = None

    def read(self, sentence: str) -> Iterator[tuple[int, tuple[int, ...] | None]]:
        """Yield (robot id, targets); None for a robot that gets none."""
        for match in _TOKEN.finditer(sentence):
            kind = _Kind[match.lastgroup or ""]
            numbers = tuple(int(digits) for digits in re.findall(r"\d+", match.group()))
            yield from self._take(kind, numbers)
            self.last = kind

    def _take(
        self, kind: _Kind, numbers: tuple[int, ...]
    ) -> Iterator[tuple[int, tuple[int, ...] | None]]:
        match kind:
            case _Kind.ROBOTS:
                yield from self._robots(numbers)
            case _Kind.TARGETS:
                yield from self._targets(numbers)
            case _Kind.NUMBERS if self.last is _Kind.SEPARATOR and self.robots:
                # "Drone 21: 122, 124"; a number anywhere else is a figure.
                yield from self._targets(numbers)
            case _Kind.NOBODY if self.robots and not self.pending:
                yield from ((robot_id, None) for robot_id in self.robots)
            case _Kind.NOT:
                self.meant = False
            case _Kind.TURN:
                self.meant = True
            case _Kind.VERB:
                # "not track" stays negated, "avoid zone 1 and track" does not.
                self.meant = self.meant or self.last is not _Kind.NOT
                self.asked = True
            case _Kind.SEPARATOR:
                self.asked = True
            case _Kind.PASSIVE:
                self.passive = True
                # "switch from Target 1 to Target 2": what follows is meant again.
                self.meant = self.meant or bool(self.robots)

    def _robots(self, numbers: tuple[int, ...]) -> Iterator[tuple[int, tuple[int, ...] | None]]:
        if self.pending and (self.passive or self.asked):
            if self.meant:
                yield from ((robot_id, self.pending) for robot_id in numbers)
            if self.last is not _Kind.ROBOTS:
                self.robots = ()
            return
        if self.last is _Kind.ROBOTS:
            self.robots += numbers
        else:
            self.robots, self.meant, self.asked = numbers, True, False

    def _targets(self, numbers: tuple[int, ...]) -> Iterator[tuple[int, tuple[int, ...] | None]]:
        if not self.robots:
            if self.last is _Kind.TARGETS:
                self.pending += numbers
            elif self.meant:
                self.pending, self.passive = numbers, False
                self.asked = self.last in (_Kind.VERB, _Kind.SEPARATOR)
            else:
                self.pending = ()
        elif self.asked and self.meant:
            yield from ((robot_id, numbers) for robot_id in self.robots)


def assignment(text: str) -> Rows | None:
    """Read an assignment; None where no robot is given anything.

    Lines that begin with a robot are the answer; other prose counts only without them.
    """
    lines = [_bare(line) for line in text.splitlines()]
    answers = [line for line in lines if _ANSWER_LINE.match(line)]
    return _rows(answers) or _rows(lines)


def _rows(lines: list[str]) -> Rows | None:
    rows: dict[int, list[int]] = {}
    for line in lines:
        for sentence in _SENTENCE.split(line):
            for robot_id, target_ids in _Reader().read(sentence):
                row = rows.setdefault(robot_id, [])
                row.extend(t for t in target_ids or () if t not in row)
    return tuple((robot_id, tuple(row)) for robot_id, row in rows.items()) or None


def _bare(line: str) -> str:
    """Return a line without bullets, numbering, quotation and emphasis."""
    return _BULLET.sub("", _MARKUP.sub("", line)).strip().strip('"').strip("|").strip()


# ---------------------------------------------------------------------------- weights

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf(?:inity)?)"
_LIST = re.compile(r"\[([^\[\]]{0,200})\]")
_NAMED = {
    name: re.compile(rf"(?:{name}|w{k})\b[^\d\n+-]{{0,40}}?({_NUMBER})(?![\w.]*\))", re.I)
    for k, name in enumerate(Weights._fields, start=1)
}
_SEVERITY = re.compile(
    rf"severity\s+of\s+(?:the\s+)?(?:\w+\s+)?zone\s+([\w.-]+?)\s*"
    rf"(?::|=|should\s+be|to|is)\s*({_NUMBER})",
    re.I,
)
_REPLAN = re.compile(
    r"\breplan\s+(?:the\s+)?(?:drones?|robots?)\s*(\d{1,9}(?:\s*(?:,|and)\s*\d{1,9})*)", re.I
)


def weights(text: str) -> tuple[float, ...] | None:
    """Read a list of numbers in brackets (the last one), or four named numbers."""
    plain = _MARKUP.sub("", text)
    lists = [_numbers(inner) for inner in _LIST.findall(plain)]
    readable = [values for values in lists if values is not None]
    if readable:
        return readable[-1]
    named = [pattern.search(plain) for pattern in _NAMED.values()]
    found = [float(match.group(1)) for match in named if match]
    return tuple(found) if len(found) == len(_NAMED) else None


def _numbers(inner: str) -> tuple[float, ...] | None:
    parts = [part for part in re.split(r"[,;\s]+", inner) if part]
    if not all(re.fullmatch(_NUMBER, part, re.I) for part in parts):
        return None
    return tuple(float(part) for part in parts)


def severities(text: str) -> tuple[tuple[str, float], ...]:
    """Read lines such as "Severity of zone s1: 2"."""
    return tuple((m[1], float(m[2])) for m in _SEVERITY.finditer(_MARKUP.sub("", text)))


def replans(text: str) -> tuple[int, ...]:
    """Read lines such as "Replan Drone 21"."""
    found = [int(d) for m in _REPLAN.finditer(text) for d in re.findall(r"\d+", m[1])]
    return tuple(dict.fromkeys(found))
