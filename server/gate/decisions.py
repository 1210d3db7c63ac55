"""Decision cards: what became of every proposal, and why. Immutable; told as JSON.

A card is written when a proposal is decided, and again, under the same id, when more is
known of it: a person has answered, or its horizon is over and what it really did has shown.
"""

from dataclasses import dataclass
from enum import StrEnum

from server.gate.merit import Merit
from server.mission.setup import GateMode
from solver.directives import Directives, Pin, Source, Verdict, Weights


class Loop(StrEnum):
    """Whose turn a proposal came from."""

    TASK = "task"
    ACTION = "action"
    SOLVER = "solver"
    """Our own assignment solver, or the repair after a loss."""

    PEOPLE = "people"


LOOPS = {
    Source.TASK_LLM: Loop.TASK,
    Source.ACTION_LLM: Loop.ACTION,
    Source.EXACT: Loop.SOLVER,
    Source.REPAIR: Loop.SOLVER,
    Source.OPERATOR: Loop.PEOPLE,
}


class Status(StrEnum):
    """Where a decision stands."""

    PENDING = "pending"
    """It waits for a person."""

    ADOPTED = "adopted"
    REFUSED = "refused"


class Refuser(StrEnum):
    """What stood in a proposal's way."""

    NO_ANSWER = "no_answer"
    """The model gave none: silent, unreachable, too slow."""

    PARSING = "parsing"
    """There was an answer, and nothing in it to verify."""

    VERIFICATION = "verification"
    GATE = "gate"
    PERSON = "person"
    TIMEOUT = "timeout"
    """Nobody approved in time."""


class Judgement(StrEnum):
    """What the gate made of a proposal."""

    UNCHANGED = "unchanged"
    """It asks for what is in force: there is nothing to judge."""

    BETTER = "better"
    NOT_WORSE = "not_worse"
    """Worse by no more than the margin."""

    CLEARLY_WORSE = "clearly_worse"
    UNJUDGED = "unjudged"
    """No prediction: the gate is off, or it did not come in time."""


@dataclass(frozen=True, slots=True)
class RowChange:
    """What one robot gets and gives away."""

    robot_id: int
    gains: tuple[int, ...]
    loses: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Changes:
    """The differences a proposal makes. Old and new values; empty where nothing differs."""

    assignment: tuple[RowChange, ...] = ()
    weights: tuple[tuple[str, float, float], ...] = ()
    capacities: tuple[tuple[int, int, int], ...] = ()
    severities: tuple[tuple[str, float, float], ...] = ()
    pins_set: tuple[Pin, ...] = ()
    pins_lifted: tuple[str, ...] = ()
    replan: tuple[int, ...] = ()

    def __bool__(self) -> bool:
        """Return whether anything differs."""
        return any(
            (
                self.assignment,
                self.weights,
                self.capacities,
                self.severities,
                self.pins_set,
                self.pins_lifted,
                self.replan,
            )
        )


class FactKind(StrEnum):
    """What a cited fact is about."""

    TRACE = "trace"
    ZONE = "zone"
    ATTACK = "attack"
    FAILURE = "failure"
    COMMENT = "comment"


@dataclass(frozen=True, slots=True)
class Fact:
    """One fact that the proposal was made from, or that its words name."""

    kind: FactKind
    text: str
    """In plain words."""

    robot_id: int | None = None
    zone_id: str | None = None
    comment_id: str | None = None
    value: float | None = None
    time_s: float | None = None


@dataclass(frozen=True, slots=True)
class GateVerdict:
    """What the gate predicted, and what follows from it."""

    mode: GateMode
    judgement: Judgement
    reason: str
    """In plain words."""

    horizon_s: float | None = None
    in_force: Merit | None = None
    proposed: Merit | None = None
    difference: float | None = None
    """Merit of the proposal less that of the directives in force, m^2; negative is better."""

    margin: float | None = None
    """Worse by more than this is clearly worse, m^2."""


@dataclass(frozen=True, slots=True)
class Approval:
    """A person's word, or the time until which it is waited for."""

    asked_s: float
    expires_s: float
    approved: bool | None = None
    by: str = ""


@dataclass(frozen=True, slots=True)
class Effect:
    """The predicted effect of what went into force, and the real one once it is over."""

    from_s: float
    until_s: float
    predicted: Merit
    predicted_merit: float
    realised: Merit | None = None
    realised_merit: float | None = None
    overlapped_by: tuple[str, ...] = ()
    """Decisions that changed something within the window: the effect is theirs too."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """One prompt and the raw answer to it."""

    prompt: str
    answer: str
    reasons: tuple[str, ...]
    """Why it was refused; empty when it was valid."""


@dataclass(frozen=True, slots=True)
class Decision:
    """One card."""

    id: str
    proposal_id: str
    loop: Loop
    source: Source
    author: str
    """The person, the model's loop or the solver."""

    asked_s: float
    """Mission time of the snapshot that the proposal was made from."""

    time_s: float
    """Mission time of its arrival."""

    status: Status
    refused_by: Refuser | None = None
    reasons: tuple[str, ...] = ()
    decided_s: float | None = None
    changes: Changes = Changes()
    facts: tuple[Fact, ...] = ()
    feedback: str = ""
    """The asker's own words."""

    tries: int = 1
    verification: Verdict | None = None
    """None where there was nothing to verify."""

    gate: GateVerdict | None = None
    approval: Approval | None = None
    effect: Effect | None = None
    comment_ids: tuple[str, ...] = ()
    """The comments that stood in the prompt or are answered."""

    @property
    def accepted(self) -> bool:
        """Whether it is in force, or was."""
        return self.status is Status.ADOPTED


def changes_between(before: Directives, after: Directives, replan: tuple[int, ...] = ()) -> Changes:
    """Return how two sets of directives differ. Soft pins are consequences, not changes."""
    rows, (old_rows, new_rows) = [], (before.rows(), after.rows())
    for robot_id, _ in before.capacities:
        old, new = set(old_rows.get(robot_id, ())), set(new_rows.get(robot_id, ()))
        if old != new:
            rows.append(RowChange(robot_id, tuple(sorted(new - old)), tuple(sorted(old - new))))
    capacities = dict(after.capacities)
    severities = dict(before.severities), dict(after.severities)
    zones = sorted(severities[0].keys() | severities[1].keys())
    old_pins = {pin.id: pin for pin in before.pins if pin.comment_id is None}
    new_pins = {pin.id: pin for pin in after.pins if pin.comment_id is None}
    return Changes(
        assignment=tuple(rows),
        weights=tuple(
            (name, old, new)
            for name, old, new in zip(Weights._fields, before.weights, after.weights, strict=True)
            if old != new
        ),
        capacities=tuple(
            (robot_id, old, capacities[robot_id])
            for robot_id, old in before.capacities
            if capacities.get(robot_id, old) != old
        ),
        severities=tuple(
            (zone, severities[0].get(zone, 1.0), severities[1].get(zone, 1.0))
            for zone in zones
            if severities[0].get(zone, 1.0) != severities[1].get(zone, 1.0)
        ),
        pins_set=tuple(pin for pin in new_pins.values() if old_pins.get(pin.id) != pin),
        pins_lifted=tuple(pin_id for pin_id in old_pins if pin_id not in new_pins),
        replan=replan,
    )
