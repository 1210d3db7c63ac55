"""What people and models may change, and how they ask for it.

Directives are in force; a proposal asks for other ones; a verdict says whether it may.
Only the mission turns a proposal into directives, and only after verification
(paper, sections III-C and III-D, eq. 4).
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple


class Weights(NamedTuple):
    """Objective weights in the paper's order w1..w4 (eq. 3)."""

    tracking: float
    control: float
    sensing: float
    communication: float


class Source(StrEnum):
    """Who asked."""

    SCENARIO = "scenario"
    TASK_LLM = "task_llm"
    ACTION_LLM = "action_llm"
    EXACT = "exact"
    REPAIR = "repair"
    OPERATOR = "operator"


class Pairing(NamedTuple):
    """One assigned pair."""

    robot_id: int
    target_id: int


@dataclass(frozen=True, slots=True)
class Pin:
    """A pair that must stay assigned (or unassigned) until it expires."""

    id: str
    pair: Pairing
    expires_s: float | None
    """Mission time, None for never."""

    comment_id: str | None = None
    """The comment that caused it (a soft pin), None for an operator's own (hard) pin."""

    forbids: bool = False
    """True keeps the pair unassigned instead."""


@dataclass(frozen=True, slots=True)
class Directives:
    """Everything in force that people and models may change. Immutable."""

    assignment: frozenset[Pairing]
    """The ones of A in {0,1}^(M x N)."""

    weights: Weights
    capacities: tuple[tuple[int, int], ...]
    """(robot id, most targets tracked at once), one entry per robot, in team order."""

    severities: tuple[tuple[str, float], ...] = ()
    """(zone id, multiplier in [1, 5]) for zones that differ from 1."""

    pins: tuple[Pin, ...] = ()
    assignment_source: Source = Source.SCENARIO
    assignment_since_s: float = 0.0
    weights_source: Source = Source.SCENARIO
    weights_since_s: float = 0.0

    def targets_of(self, robot_id: int) -> tuple[int, ...]:
        """Return the ids of the targets assigned to a robot, ascending."""
        return tuple(sorted(p.target_id for p in self.assignment if p.robot_id == robot_id))

    def rows(self) -> dict[int, tuple[int, ...]]:
        """Return `targets_of` every robot that has any, by its id."""
        rows: dict[int, list[int]] = {}
        for pair in self.assignment:
            rows.setdefault(pair.robot_id, []).append(pair.target_id)
        return {robot_id: tuple(sorted(row)) for robot_id, row in rows.items()}

    def severity_of(self, zone_id: str) -> float:
        """Return a zone's severity multiplier (1 where nothing was said)."""
        return dict(self.severities).get(zone_id, 1.0)


class CommentVerdict(StrEnum):
    """What one loop made of a comment."""

    APPLIED = "applied"
    PARTLY = "partly_applied"
    DECLINED = "declined"
    NOTED = "noted"
    """Understood, and nothing of this loop had to change for it."""


@dataclass(frozen=True, slots=True)
class CommentAnswer:
    """One loop's answer to one comment."""

    comment_id: str
    verdict: CommentVerdict
    reason: str


@dataclass(frozen=True, slots=True)
class Proposal:
    """What a model or a person asks for, as said: ids and numbers may be wrong."""

    id: str
    source: Source
    asked_s: float
    """Mission time of the snapshot it was made from."""

    assignment: tuple[tuple[int, tuple[int, ...]], ...] | None = None
    """(robot id, target ids) per named robot; a robot left out gets no target."""

    weights: tuple[float, ...] | None = None
    capacities: tuple[tuple[int, int], ...] | None = None
    severities: tuple[tuple[str, float], ...] | None = None
    replan: tuple[int, ...] = ()
    """Robots to be started afresh by the optimizer (probe starts)."""

    feedback: str = ""
    """The model's words to the human supervisor."""

    comment_answers: tuple[CommentAnswer, ...] = ()
    considered: tuple[str, ...] = ()
    """Ids of the comments that stood in the prompt."""

    author: str = ""
    """The person who asks, where one does."""

    pins_set: tuple[Pin, ...] = ()
    """Hard pins of a person's own, new or changed."""

    pins_lifted: tuple[str, ...] = ()
    """Ids of pins to be taken away."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verification's answer to a proposal. Accepted exactly when nothing is violated."""

    proposal_id: str
    violations: tuple[str, ...] = ()
    """Each in words that can be told to a model or a person."""

    @property
    def accepted(self) -> bool:
        """Whether the proposal may become directives."""
        return not self.violations
