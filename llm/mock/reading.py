"""From the words of a prompt back to facts. This is all the mock ever learns."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class SeenRobot:
    """One robot as the prompt tells it."""

    id: int
    position: Point
    velocity: Point = (0.0, 0.0)
    commanded: Point = (0.0, 0.0)
    row: tuple[int, ...] = ()
    capacity: int = 0
    blind: bool = False
    cut_off: bool = False
    lost: bool = False
    still: tuple[float, float] | None = None
    """Metres it has moved in how many seconds, where that was told."""

    @property
    def free(self) -> bool:
        """Whether its targets may be changed."""
        return not (self.cut_off or self.lost)


@dataclass(frozen=True, slots=True)
class SeenTarget:
    """One target; its position is None until it has been seen."""

    id: int
    position: Point | None
    velocity: Point = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class SeenZone:
    """One known danger zone."""

    label: str
    kind: str
    position: Point
    keep_out_m: float
    severity: float


@dataclass(frozen=True, slots=True)
class SeenAttack:
    """A robot was hit, by a zone whose label is None where it is unknown."""

    robot: int
    kind: str
    zone: str | None


@dataclass(frozen=True, slots=True)
class SeenPin:
    """A pair that is fixed."""

    robot: int
    target: int
    forbids: bool


@dataclass(frozen=True, slots=True)
class SeenComment:
    """A comment of the human supervisor."""

    label: str
    age_s: float
    verdict: str | None
    """What this model answered before; None for a new one."""

    text: str

    @property
    def new(self) -> bool:
        """Whether it waits for an answer."""
        return self.verdict is None


@dataclass(frozen=True, slots=True)
class Reading:
    """Everything understood of a prompt."""

    loop: str
    """task, action, or nothing when the prompt is none of ours."""

    wants_json: bool
    robots: tuple[SeenRobot, ...]
    targets: tuple[SeenTarget, ...]
    zones: tuple[SeenZone, ...]
    attacks: tuple[SeenAttack, ...]
    """The new ones."""

    past_attacks: tuple[SeenAttack, ...]
    past_traces: tuple[float, ...]
    pins: tuple[SeenPin, ...]
    comments: tuple[SeenComment, ...]
    weights: tuple[float, ...]
    bounds: tuple[tuple[float, float], ...]
    severity_upper: float
    trace: float | None
    rung: str | None
    offers: frozenset[str]
    """Optional parts of the answer: capacities, severities, replan."""


_N = r"-?\d+(?:\.\d+)?"
_P = rf"\(({_N}), ({_N})\)"
_ROBOT = re.compile(
    rf"^Drone (\d+) is at {_P}(?:, velocity {_P}, commanded {_P}, (.+?); it tracks (.+?), "
    r"(?:can track at most (\d+) targets?|its targets cannot be changed)| by its last report, "
    r"(lost))\.$",
    re.M,
)
_STILL = re.compile(rf"^Drone (\d+) stands still: it has moved ({_N}) m in ({_N}) s\.$", re.M)
_TARGET = re.compile(rf"^Target (\d+) (?:is at {_P}, velocity {_P}|has not been seen yet)", re.M)
_ZONE = re.compile(
    rf"^(Sensing|Communication) zone (\S+) is at {_P}, keep-out ({_N}) m[^\n]*?severity ({_N})",
    re.M,
)
_ATTACK = re.compile(
    r"Drone (\d+) by (?:an unknown )?(sensing|communication) zone(?: (\S+?))?(?=[;.]| and \d)"
)
_PIN = re.compile(r"^Drone (\d+) (must keep|must not track) Target (\d+), by ", re.M)
_COMMENT = re.compile(r'^(\S+), (\d+) s old, (?:(new)|answered (\w+), still stands): (".*")$', re.M)
_BLOCK = re.compile(r"^<<<COMMENTS\n(.*?)^COMMENTS>>>$", re.M | re.S)
_RESULT = re.compile(r"^\d+\. At [\d.]+ s: .*? Attacked: (.*?)\. .*? ?Trace ([\d.]+)\.$", re.M)
_TRACES = re.compile(r"^The recent traces, oldest first: ([\d., ]+)\.$", re.M)
_TRACE = re.compile(rf"^The last trace of the estimation covariance is ({_N})\.$", re.M)
_WEIGHTS = re.compile(r"^The current weights are \[([^\]]+)\]\.$", re.M)
_BOUND = re.compile(rf"(?:tracking|control|sensing|communication) between ({_N}) and ({_N})")
_SEVERITY = re.compile(rf"^The severity of a zone may be raised to ({_N})\.$", re.M)
_RUNG = re.compile(r"^The last optimization ended (\w+)\.$", re.M)


def read(messages: Sequence[tuple[str, str]]) -> Reading:
    """Understand a conversation of (role, content)."""
    system = "\n".join(content for role, content in messages if role == "system")
    user = next((content for role, content in messages if role == "user"), "")
    block = _BLOCK.search(user)
    comments = _comments(block.group(1)) if block else ()
    # Facts are read outside the block only: a comment cannot pose as a fact.
    facts = user[: block.start()] + user[block.end() :] if block else user
    bounds = next((line for line in facts.splitlines() if line.startswith("Bounds: ")), "")
    weights = _WEIGHTS.search(facts)
    severity = _SEVERITY.search(facts)
    trace = _TRACE.search(facts)
    rung = _RUNG.search(facts)
    still = {int(m[1]): (float(m[2]), float(m[3])) for m in _STILL.finditer(facts)}
    past = list(_RESULT.finditer(facts))
    compact = _TRACES.search(facts)
    new = next((line for line in facts.splitlines() if line.startswith("New attacks: ")), "")
    return Reading(
        loop=_loop(system),
        wants_json="Answer with one JSON object" in system,
        robots=tuple(
            replace(_robot(match), still=still.get(int(match[1])))
            for match in _ROBOT.finditer(facts)
        ),
        targets=tuple(_target(match) for match in _TARGET.finditer(facts)),
        zones=tuple(
            SeenZone(m[2], m[1].lower(), (float(m[3]), float(m[4])), float(m[5]), float(m[6]))
            for m in _ZONE.finditer(facts)
        ),
        attacks=_attacks(new),
        past_attacks=tuple(attack for m in past for attack in _attacks(f"{m[1]}.")),
        past_traces=tuple(
            float(value) for value in (compact[1].split(", ") if compact else [m[2] for m in past])
        ),
        pins=tuple(
            SeenPin(int(m[1]), int(m[3]), m[2] == "must not track") for m in _PIN.finditer(facts)
        ),
        comments=comments,
        weights=tuple(float(v) for v in weights[1].split(", ")) if weights else (),
        bounds=tuple((float(m[1]), float(m[2])) for m in _BOUND.finditer(bounds)),
        severity_upper=float(severity[1]) if severity else 1.0,
        trace=float(trace[1]) if trace else None,
        rung=rung[1] if rung else None,
        offers=frozenset(
            name
            for name, marks in (
                ("capacities", ('"capacities"',)),
                ("severities", ('"severities"', '"Severity of zone')),
                ("replan", ('"replan"', '"Replan Drone')),
            )
            if any(mark in system for mark in marks)
        ),
    )


def _loop(system: str) -> str:
    if "assigns drones" in system:
        return "task"
    return "action" if "sets the weights" in system else ""


def _robot(match: re.Match[str]) -> SeenRobot:
    place = (float(match[2]), float(match[3]))
    if match[11]:
        return SeenRobot(int(match[1]), place, lost=True)
    row = tuple(int(digits) for digits in re.findall(r"\d+", match[9]))
    return SeenRobot(
        id=int(match[1]),
        position=place,
        velocity=(float(match[4]), float(match[5])),
        commanded=(float(match[6]), float(match[7])),
        row=row,
        capacity=int(match[10]) if match[10] else len(row),
        blind="sensing failure" in match[8],
        cut_off="communication failure" in match[8],
    )


def _target(match: re.Match[str]) -> SeenTarget:
    if match[2] is None:
        return SeenTarget(int(match[1]), None)
    return SeenTarget(
        int(match[1]), (float(match[2]), float(match[3])), (float(match[4]), float(match[5]))
    )


def _attacks(words: str) -> tuple[SeenAttack, ...]:
    return tuple(SeenAttack(int(m[1]), m[2], m[3]) for m in _ATTACK.finditer(words))


def _comments(block: str) -> tuple[SeenComment, ...]:
    return tuple(
        SeenComment(m[1], float(m[2]), None if m[3] else m[4], json.loads(m[5]))
        for m in _COMMENT.finditer(block)
    )
