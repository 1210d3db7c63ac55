"""One logical call of a model: prompt, answer, verification, bounded retries in words.

Sans I/O: whoever drives it sends `request`, hands the reply to `receive` (or the error to
`fail`) and does what the outcome says. The very same machine runs live and in lockstep,
where every try costs its own latency in virtual time.

An answer is verified against the snapshot of its arrival. A refused answer changes nothing;
its violations are told to the model, with the facts as they are by then.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

from llm import words
from llm.answers import (
    ActionAnswer,
    AnswerError,
    SaidOfComment,
    TaskAnswer,
    is_whole,
    read_action,
    read_task,
)
from llm.chat import ChatReply, ChatRequest, ErrorKind, Message, ModelError
from llm.facts import zone_labels
from llm.prompts import Loop, PromptView, request_for
from llm.verification import PROMPT_ROUNDING, assignment_of, verify, with_frozen_rows
from solver.directives import CommentAnswer, CommentVerdict, Proposal, Source, Verdict
from solver.snapshot import Snapshot

MAX_TRIES = 3
MOST_VIOLATIONS = 12
"""Sentences told to a model at once."""

LONGEST_ECHO = 2000
"""Characters of a refused answer that are shown to the model again."""

CUT_OFF = "The answer ended at the token limit before it was complete; be brief."

_SOURCES = {Loop.TASK: Source.TASK_LLM, Loop.ACTION: Source.ACTION_LLM}
_AGAIN = frozenset({ErrorKind.BAD_REPLY, ErrorKind.TOO_LARGE})
"""Failures after which the same question may be answered; the client retries the others."""


@dataclass(frozen=True, slots=True, eq=False)
class Retry:
    """Ask again: the answer was refused for these reasons."""

    request: ChatRequest
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Accepted:
    """The proposal passed verification. Whether it is adopted is the gate's matter."""

    proposal: Proposal
    verdict: Verdict


@dataclass(frozen=True, slots=True, eq=False)
class GivenUp:
    """No try was accepted. The directives in force stay as they are."""

    reasons: tuple[str, ...]


Outcome = Retry | Accepted | GivenUp


class Fault(StrEnum):
    """What was wrong with an attempt."""

    NO_REPLY = "no_reply"
    UNREADABLE = "unreadable"
    """There was nothing in it to verify."""

    VIOLATION = "violation"


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One request and what came of it, for the journal and the decision cards."""

    request: ChatRequest
    text: str
    reasons: tuple[str, ...] = ()
    """Why it was refused; empty when it was accepted."""

    fault: Fault | None = None


@dataclass(frozen=True, slots=True)
class ConsultationStats:
    """One logical call, counted as the paper counts."""

    tries: int = 0
    """Requests."""

    valid_first: bool = False
    """The first answer passed verification."""

    valid: bool = False
    """An answer passed verification, be it after retries."""

    tokens_in: int = 0
    tokens_out: int = 0
    latency_s: float = 0.0
    """Sum over the tries, as measured."""


@dataclass(eq=False)
class Consultation:
    """The state of one logical call."""

    loop: Loop
    view: PromptView
    proposal_id: str
    request: ChatRequest
    max_tries: int = MAX_TRIES
    stats: ConsultationStats = field(default_factory=ConsultationStats, init=False)
    attempts: list[Attempt] = field(default_factory=list, init=False)

    def receive(self, reply: ChatReply, snapshot: Snapshot) -> Outcome:
        """Judge a reply against the snapshot at its arrival."""
        self.stats = replace(
            self.stats,
            tries=self.stats.tries + 1,
            tokens_in=self.stats.tokens_in + reply.tokens_in,
            tokens_out=self.stats.tokens_out + reply.tokens_out,
            latency_s=self.stats.latency_s + reply.latency_s,
        )
        # It is echoed to the model, shown to people and kept in the journal.
        text = words.writable(reply.text)
        if reply.finish == "length" and not is_whole(text):
            return self._refused(text, (CUT_OFF,), snapshot, Fault.UNREADABLE)
        try:
            proposal = self._proposal(text, snapshot)
        except AnswerError as error:
            return self._refused(text, (str(error),), snapshot, Fault.UNREADABLE)
        verdict = verify(proposal, snapshot, self.view.limits)
        if not verdict.accepted:
            return self._refused(text, verdict.violations, snapshot, Fault.VIOLATION)
        self.attempts.append(Attempt(self.request, text))
        first = self.stats.tries == 1
        self.stats = replace(self.stats, valid=True, valid_first=first)
        return Accepted(proposal, verdict)

    def fail(self, error: ModelError) -> Outcome:
        """Take note that there was no reply."""
        self.stats = replace(self.stats, tries=self.stats.tries + 1)
        self.attempts.append(Attempt(self.request, "", (error.words,), Fault.NO_REPLY))
        if error.kind in _AGAIN and self.stats.tries < self.max_tries:
            return Retry(self.request, (error.words,))
        return GivenUp((error.words,))

    def _refused(
        self, text: str, reasons: Sequence[str], snapshot: Snapshot, fault: Fault
    ) -> Outcome:
        told = tuple(reasons)
        self.attempts.append(Attempt(self.request, text, told, fault))
        if self.stats.tries >= self.max_tries:
            return GivenUp(told)
        self.view = self.view.at(snapshot)
        fresh = request_for(self.loop, self.view)
        self.request = replace(
            fresh,
            messages=(
                *fresh.messages,
                Message("assistant", words.cut(text, LONGEST_ECHO) or "(nothing)"),
                Message("user", _refusal_words(told)),
            ),
        )
        return Retry(self.request, told)

    def _proposal(self, text: str, snapshot: Snapshot) -> Proposal:
        """Turn an answer into a proposal; ids and numbers stay as said.

        Raises:
            AnswerError: when there is nothing to verify.
        """
        empty = Proposal(
            id=self.proposal_id,
            source=_SOURCES[self.loop],
            asked_s=self.view.snapshot.time_s,
            considered=tuple(receipt.comment.id for receipt in self.view.receipts),
        )
        if self.loop is Loop.TASK:
            task = read_task(text)
            proposal, said = _task_proposal(empty, task, snapshot), task.comments
        else:
            action = read_action(text)
            proposal, said = _action_proposal(empty, action, self.view.snapshot), action.comments
        return replace(proposal, comment_answers=self._comment_answers(said, proposal, snapshot))

    def _comment_answers(
        self, said: Sequence[SaidOfComment], proposal: Proposal, snapshot: Snapshot
    ) -> tuple[CommentAnswer, ...]:
        """Return one answer per comment this loop has not answered yet.

        What a model claims to have applied counts only if its proposal changes something.
        Where it says nothing (plain lines), a change counts as the comment's effect.
        """
        changed = changes(proposal, snapshot)
        by_label = {answer.label: answer for answer in said}
        names = self.view.comment_labels()
        answers = []
        for receipt in self.view.unanswered(self.loop):
            comment_id = receipt.comment.id
            told = by_label.get(names[comment_id])
            verdict = CommentVerdict.APPLIED if told is None else told.verdict
            if verdict in (CommentVerdict.APPLIED, CommentVerdict.PARTLY) and not changed:
                verdict = CommentVerdict.NOTED
            reason = (told.reason if told is not None else "") or proposal.feedback
            answers.append(CommentAnswer(comment_id, verdict, reason))
        return tuple(answers)


def consult(
    loop: Loop, view: PromptView, proposal_id: str, max_tries: int = MAX_TRIES
) -> Consultation:
    """Begin a logical call of one of the two models."""
    return Consultation(loop, view, proposal_id, request_for(loop, view), max_tries)


def consult_task(view: PromptView, proposal_id: str, max_tries: int = MAX_TRIES) -> Consultation:
    """Begin a logical call of the task model."""
    return consult(Loop.TASK, view, proposal_id, max_tries)


def consult_action(view: PromptView, proposal_id: str, max_tries: int = MAX_TRIES) -> Consultation:
    """Begin a logical call of the action model."""
    return consult(Loop.ACTION, view, proposal_id, max_tries)


def changes(proposal: Proposal, snapshot: Snapshot) -> bool:
    """Return whether a proposal asks for anything that is not in force already."""
    directives = snapshot.directives
    if proposal.assignment is not None and assignment_of(proposal) != directives.assignment:
        return True
    capacities = dict(directives.capacities)
    if any(capacities.get(robot_id) != c for robot_id, c in proposal.capacities or ()):
        return True
    if proposal.weights is not None and not _same(proposal.weights, directives.weights):
        return True
    return bool(proposal.replan) or any(
        not _same((severity,), (directives.severity_of(zone_id),))
        for zone_id, severity in proposal.severities or ()
    )


def _same(asked: Sequence[float], current: Sequence[float]) -> bool:
    """Compare numbers that a prompt has rounded."""
    return len(asked) == len(current) and all(
        abs(a - b) <= PROMPT_ROUNDING * abs(b) for a, b in zip(asked, current, strict=True)
    )


def _task_proposal(empty: Proposal, answer: TaskAnswer, snapshot: Snapshot) -> Proposal:
    return replace(
        empty,
        assignment=with_frozen_rows(answer.assignment, snapshot),
        capacities=answer.capacities or None,
        feedback=answer.feedback,
    )


def _action_proposal(empty: Proposal, answer: ActionAnswer, asked: Snapshot) -> Proposal:
    ids = {label: zone_id for zone_id, label in zone_labels(asked).items()}
    severities = tuple((ids.get(label, label), value) for label, value in answer.severities)
    return replace(
        empty,
        weights=answer.weights,
        severities=severities or None,
        replan=answer.replan,
        feedback=answer.feedback,
    )


def _refusal_words(reasons: Sequence[str]) -> str:
    told = [f"- {reason}" for reason in reasons[:MOST_VIOLATIONS]]
    if len(reasons) > MOST_VIOLATIONS:
        told.append(f"- and {len(reasons) - MOST_VIOLATIONS} more.")
    return "\n".join(
        ("Your answer was refused:", *told, "Give a whole new answer in the same format.")
    )
