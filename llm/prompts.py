"""The prompts of the task and the action model (paper, sections III-C and III-D).

What stays the same for a team comes first (role, rules, format), so that an endpoint's
prefix cache helps; then zones, the history, the present, and the request. Human comments
are quoted as data in a marked block (`llm.quoting`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Self

from llm import facts, schemas, words
from llm.chat import ChatRequest, Message
from llm.coverage import Team
from llm.history import HistoryEntry
from llm.instructions import action_system, task_system
from llm.quoting import BLOCK_END, BLOCK_START, labels, quoted
from llm.styles import AnswerForm, Examples, Loop, PromptStyle
from llm.verification import WEIGHT_NAMES, Limits
from solver.directives import CommentVerdict
from solver.observations import Attack
from solver.snapshot import CommentReceipt, Snapshot

__all__ = [
    "AnswerForm",
    "Examples",
    "Loop",
    "PromptStyle",
    "PromptView",
    "action_request",
    "request_for",
    "task_request",
    "token_limit",
    "verdict_of",
]

MOST_COMMENTS = 12
"""The newest comments that a prompt carries."""

TOKENS_PER_COMMENT = 120
"""Room for the answer to one comment, on top of the paper's token limit."""


@dataclass(frozen=True, slots=True, eq=False)
class PromptView:
    """Everything a prompt is made from. Pure data; equal views give equal prompts."""

    snapshot: Snapshot
    limits: Limits
    history: tuple[HistoryEntry, ...] = ()
    """The last k results, oldest first."""

    attacks: tuple[Attack, ...] | None = None
    """Those since the newest result; the snapshot's own where None."""

    form: AnswerForm = AnswerForm.JSON
    style: PromptStyle = PromptStyle.FULL
    examples: Examples = Examples.WITHOUT

    def at(self, snapshot: Snapshot) -> Self:
        """Return the same view of a later snapshot."""
        return replace(self, snapshot=snapshot)

    @property
    def receipts(self) -> tuple[CommentReceipt, ...]:
        """The comments the prompt carries, oldest first."""
        return self.snapshot.receipts[-MOST_COMMENTS:]

    def comment_labels(self) -> Mapping[str, str]:
        """Return comment id -> label in the prompt."""
        return labels(receipt.comment.id for receipt in self.receipts)

    def unanswered(self, loop: Loop) -> tuple[CommentReceipt, ...]:
        """Return the comments this loop has not answered yet."""
        return tuple(r for r in self.receipts if verdict_of(r, loop) is None)


def verdict_of(receipt: CommentReceipt, loop: Loop) -> CommentVerdict | None:
    """Return one loop's verdict on a comment, None while it has none."""
    return receipt.task if loop is Loop.TASK else receipt.action


def task_request(view: PromptView) -> ChatRequest:
    """Ask for a new assignment."""
    snapshot = view.snapshot
    team = Team.of(snapshot)
    asked = _asked(view, Loop.TASK)
    if view.style is PromptStyle.COMPACT:
        extras: tuple[str, ...] = (schemas.FULL_ROWS, schemas.BRIEF)
    else:
        extras = ("capacities",) if asked else ()
    schema = schemas.task_schema(team, asked, extras)
    request = "Provide the new tracking assignment for each drone."
    return ChatRequest(
        messages=(
            Message("system", task_system(view.form, view.style, view.examples, asked)),
            Message("user", _situation(view, team, Loop.TASK, request)),
        ),
        max_tokens=token_limit(snapshot, len(asked)),
        schema=schema if view.form is AnswerForm.JSON else None,
        schema_name="task_answer",
    )


def action_request(view: PromptView) -> ChatRequest:
    """Ask for new weights."""
    snapshot = view.snapshot
    asked = _asked(view, Loop.ACTION)
    full = view.style is PromptStyle.FULL
    extras = ("severities", "replan") if full else (schemas.LEVELS, schemas.BRIEF)
    zone_names = tuple(facts.zone_labels(snapshot).values())
    schema = schemas.action_schema(snapshot, view.limits, zone_names, asked, extras)
    request = "Provide the new weights."
    return ChatRequest(
        messages=(
            Message("system", action_system(view.form, view.style, view.examples, asked)),
            Message("user", _situation(view, Team.of(snapshot), Loop.ACTION, request)),
        ),
        max_tokens=token_limit(snapshot, len(asked)),
        schema=schema if view.form is AnswerForm.JSON else None,
        schema_name="action_answer",
    )


def request_for(loop: Loop, view: PromptView) -> ChatRequest:
    """Ask one of the two models."""
    return task_request(view) if loop is Loop.TASK else action_request(view)


def token_limit(snapshot: Snapshot, comments: int = 0) -> int:
    """Return the most tokens an answer may have.

    The paper's 50 (mean capacity + 2), at least 24 M + 80 so that large teams fit, and room
    for the answers to comments.
    """
    capacities = [capacity for _, capacity in snapshot.directives.capacities]
    mean = sum(capacities) / max(1, len(capacities))
    rows = 24 * len(snapshot.robots.ids) + 80
    return max(round(50.0 * (mean + 2.0)), rows) + TOKENS_PER_COMMENT * comments


def _asked(view: PromptView, loop: Loop) -> tuple[str, ...]:
    names = view.comment_labels()
    return tuple(names[receipt.comment.id] for receipt in view.unanswered(loop))


# ---------------------------------------------------------------------------- user


def _situation(view: PromptView, team: Team, loop: Loop, request: str) -> str:
    snapshot = view.snapshot
    names = facts.zone_labels(snapshot)
    attacks = snapshot.attacks if view.attacks is None else view.attacks
    parts = [
        "Known danger zones:",
        *facts.zone_lines(snapshot),
        *_past(view, names),
        f"Now, at {facts.seconds(snapshot.time_s)} s:",
        *facts.robot_lines(snapshot, team),
        *facts.still_lines(snapshot, view.history),
        *facts.target_lines(snapshot),
        facts.attack_line(snapshot, view.history, attacks),
        f"The last trace of the estimation covariance is {words.number(round(snapshot.trace, 3))}.",
        *_solve(snapshot),
    ]
    if loop is Loop.TASK:
        parts.extend(facts.pin_lines(snapshot, team, view.comment_labels()))
    else:
        parts.extend(_weights(view))
    parts.extend(_comments(view, loop))
    parts.append(request)
    return "\n".join(parts)


def _past(view: PromptView, names: Mapping[str, str]) -> Iterator[str]:
    if not view.history:
        return
    if view.style is PromptStyle.COMPACT:
        traces = [words.number(round(entry.trace, 3)) for entry in view.history]
        yield f"The recent traces, oldest first: {', '.join(traces)}."
        return
    yield f"The recent {len(view.history)} results, oldest first:"
    yield from facts.history_lines(view.history, names)


def _solve(snapshot: Snapshot) -> Iterator[str]:
    if snapshot.solve is not None:
        yield f"The last optimization ended {snapshot.solve.rung.value}."


def _weights(view: PromptView) -> Iterator[str]:
    current = view.snapshot.directives.weights
    values = ", ".join(words.number(weight) for weight in current)
    yield f"The current weights are [{values}]."
    bounds = zip(WEIGHT_NAMES, view.limits.weights_lower, view.limits.weights_upper, strict=True)
    each = [
        f"{name} between {words.at_least(lower)} and {words.at_most(upper)}"
        for name, lower, upper in bounds
    ]
    yield f"Bounds: {', '.join(each)}."
    severity = words.at_most(view.limits.severity_upper)
    yield f"The severity of a zone may be raised to {severity}."


def _comments(view: PromptView, loop: Loop) -> Iterator[str]:
    if not view.receipts:
        yield "There are no comments of the human supervisor."
        return
    names = view.comment_labels()
    yield "Comments of the human supervisor, oldest first:"
    yield BLOCK_START
    for receipt in view.receipts:
        comment = receipt.comment
        verdict = verdict_of(receipt, loop)
        state = "new" if verdict is None else f"answered {verdict.value}, still stands"
        age_s = max(0.0, view.snapshot.time_s - comment.time_s)
        yield f"{names[comment.id]}, {age_s:.0f} s old, {state}: {quoted(comment.text)}"
    yield BLOCK_END
