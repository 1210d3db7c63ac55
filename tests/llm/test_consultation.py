import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from llm.chat import ChatReply, ErrorKind, ModelError
from llm.consultation import (
    Accepted,
    Consultation,
    GivenUp,
    Outcome,
    Retry,
    changes,
    consult_action,
    consult_task,
)
from llm.prompts import AnswerForm, PromptView
from solver.directives import CommentVerdict, Proposal, Source
from solver.observations import Link
from tests.llm.builders import LIMITS, WEIGHTS, Scene, hardware, zone


def reply(text: str, finish: str = "stop") -> ChatReply:
    return ChatReply(text, tokens_in=100, tokens_out=20, latency_s=0.5, finish=finish)


def plan(rows: dict[int, list[int]], **more: Any) -> ChatReply:
    return reply(json.dumps({"assignment": rows, "feedback": "Fine.", **more}))


def task(scene: Scene, **changes: Any) -> Consultation:
    return consult_task(replace(PromptView(scene.snapshot(), LIMITS), **changes), "p1")


def action(scene: Scene, **changes: Any) -> Consultation:
    return consult_action(replace(PromptView(scene.snapshot(), LIMITS), **changes), "p1")


def accepted(outcome: Outcome) -> Proposal:
    assert isinstance(outcome, Accepted), outcome
    assert outcome.verdict.accepted
    return outcome.proposal


def test_a_sound_answer_is_accepted_at_once() -> None:
    scene = hardware()
    call = task(scene)
    proposal = accepted(call.receive(plan({21: [124], 26: [122]}), scene.snapshot()))
    assert proposal.assignment == ((21, (124,)), (26, (122,)))
    assert (proposal.id, proposal.source, proposal.asked_s) == ("p1", Source.TASK_LLM, 10.0)
    assert proposal.feedback == "Fine."
    stats = call.stats
    assert (stats.tries, stats.valid_first, stats.valid) == (1, True, True)
    assert (stats.tokens_in, stats.tokens_out, stats.latency_s) == (100, 20, 0.5)


def test_a_refused_answer_is_told_why_and_may_be_mended() -> None:
    scene = hardware()
    call = task(scene)
    outcome = call.receive(plan({21: [122, 124, 7], 26: []}), scene.snapshot())
    assert isinstance(outcome, Retry)
    assert outcome.request is call.request
    *_, echo, refusal = outcome.request.messages
    assert echo.role == "assistant"
    assert '"21": [122, 124, 7]' in echo.content
    assert "There is no Target 7; the targets are 122 and 124." in refusal.content
    assert refusal.content.startswith("Your answer was refused:")
    accepted(call.receive(plan({21: [122], 26: [124]}), scene.snapshot()))
    stats = call.stats
    assert (stats.tries, stats.valid_first, stats.valid) == (2, False, True)
    assert (stats.tokens_in, stats.tokens_out, stats.latency_s) == (200, 40, 1.0)
    assert [bool(attempt.reasons) for attempt in call.attempts] == [True, False]


def test_tries_are_bounded() -> None:
    scene = hardware()
    call = task(scene)
    wrong = plan({21: [], 26: []})
    assert isinstance(call.receive(wrong, scene.snapshot()), Retry)
    assert isinstance(call.receive(wrong, scene.snapshot()), Retry)
    outcome = call.receive(wrong, scene.snapshot())
    assert isinstance(outcome, GivenUp)
    assert "tracked by no drone" in outcome.reasons[0]
    assert (call.stats.tries, call.stats.valid) == (3, False)


def test_conversations_do_not_grow_with_the_tries() -> None:
    scene = hardware()
    call = task(scene)
    call.receive(plan({21: []}), scene.snapshot())
    call.receive(reply("x" * 100_000), scene.snapshot())
    assert [m.role for m in call.request.messages] == ["system", "user", "assistant", "user"]
    assert len(call.request.messages[2].content) <= 2000


def test_an_answer_is_judged_at_its_arrival() -> None:
    before, after = hardware(), replace(hardware(), links={21: Link.LOST}, time_s=11.0)
    call = task(before)
    outcome = call.receive(plan({21: [122], 26: [124]}), after.snapshot())
    assert isinstance(outcome, Retry)
    assert "Drone 21 is lost and can track no target." in outcome.reasons
    assert "Drone 21 is at (-2, 1) by its last report, lost." in outcome.request.messages[1].content
    proposal = accepted(call.receive(plan({26: [122, 124]}), after.snapshot()))
    assert proposal.asked_s == 11.0


def test_jammed_robots_may_be_left_out() -> None:
    scene = replace(hardware(), links={21: Link.JAMMED})
    call = task(scene)
    proposal = accepted(call.receive(plan({26: [124]}), scene.snapshot()))
    assert dict(proposal.assignment or ()) == {21: (122,), 26: (124,)}


@pytest.mark.parametrize(
    ("text", "finish", "words"),
    [
        ("", "stop", "empty"),
        ("I'm sorry, I can't.", "stop", "refusal"),
        ('{"assignment": {"21": [12', "length", "ended at the token limit"),
        (
            "Drone 26 should track Target 124.\nDrone 21 should track Target 12",
            "length",
            "ended at",
        ),
    ],
)
def test_unreadable_answers_are_told_so(text: str, finish: str, words: str) -> None:
    scene = hardware()
    outcome = task(scene).receive(reply(text, finish), scene.snapshot())
    assert isinstance(outcome, Retry)
    assert words in outcome.reasons[0]


def test_half_a_character_is_neither_sent_back_nor_kept() -> None:
    scene = hardware()
    call = task(scene)
    outcome = call.receive(reply("Targets \ud83d."), scene.snapshot())
    assert isinstance(outcome, Retry)
    assert outcome.request.messages[-2].content == "Targets ?."
    assert call.attempts[0].text == "Targets ?."
    said = '{"assignment": {"21": [122], "26": [124]}, "feedback": "All \\ud83d well."}'
    assert accepted(call.receive(reply(said), scene.snapshot())).feedback == "All ? well."


def test_an_answer_complete_before_the_limit_counts() -> None:
    scene = hardware()
    text = '{"assignment": {"21": [122], "26": [124]}} And now I would like to'
    accepted(task(scene).receive(reply(text, "length"), scene.snapshot()))


@pytest.mark.parametrize(
    ("kind", "again"),
    [
        (ErrorKind.BAD_REPLY, True),
        (ErrorKind.TOO_LARGE, True),
        (ErrorKind.TIMEOUT, False),
        (ErrorKind.CONNECTION, False),
        (ErrorKind.UNAUTHORIZED, False),
        (ErrorKind.CIRCUIT_OPEN, False),
    ],
)
def test_failures_of_the_endpoint(kind: ErrorKind, again: bool) -> None:
    call = task(hardware())
    request = call.request
    outcome = call.fail(ModelError(kind, "no reply"))
    assert isinstance(outcome, Retry if again else GivenUp)
    assert outcome.reasons == ("no reply",)
    assert call.request is request
    assert call.stats.tries == 1


def test_failures_count_as_tries() -> None:
    call = task(hardware())
    error = ModelError(ErrorKind.BAD_REPLY, "no reply")
    assert isinstance(call.fail(error), Retry)
    assert isinstance(call.fail(error), Retry)
    assert isinstance(call.fail(error), GivenUp)


def test_an_action_answer_becomes_weights_severities_and_replans() -> None:
    name = "north ridge!"
    scene = replace(hardware(), zones=(zone(name),))
    body = {
        "weights": {"tracking": 20, "control": 0.05, "sensing": 50, "communication": 50},
        "severities": [{"zone": "north_ridge", "severity": 2}],
        "replan": [21],
        "feedback": "More room.",
    }
    proposal = accepted(action(scene).receive(reply(json.dumps(body)), scene.snapshot()))
    assert proposal.weights == (20.0, 0.05, 50.0, 50.0)
    assert proposal.severities == ((name, 2.0),), "labels become ids again"
    assert proposal.replan == (21,)
    assert proposal.source is Source.ACTION_LLM
    assert proposal.assignment is None


def test_weights_out_of_bounds_are_refused_in_words() -> None:
    scene = hardware()
    outcome = action(scene).receive(reply("[1000, 0.05, 50, 50]"), scene.snapshot())
    assert isinstance(outcome, Retry)
    assert outcome.reasons == ("Weight 1 (tracking) must be between 1 and 100, not 1000.",)


# ------------------------------------------------------------------ comments


def said(verdict: str, reason: str = "Because.") -> dict[str, Any]:
    return {"comments": [{"id": "c1", "verdict": verdict, "reason": reason}]}


SWAP, SAME = {21: [124], 26: [122]}, {21: [122], 26: [124]}


@pytest.mark.parametrize(
    ("rows", "more", "verdict", "reason"),
    [
        (SWAP, said("applied"), CommentVerdict.APPLIED, "Because."),
        (SWAP, said("partly_applied"), CommentVerdict.PARTLY, "Because."),
        (SAME, said("applied"), CommentVerdict.NOTED, "Because."),
        (SAME, said("declined"), CommentVerdict.DECLINED, "Because."),
        (SWAP, said("declined"), CommentVerdict.DECLINED, "Because."),
        (SWAP, said("noted", ""), CommentVerdict.NOTED, "Fine."),
        (SWAP, {}, CommentVerdict.APPLIED, "Fine."),
        (SAME, {}, CommentVerdict.NOTED, "Fine."),
        (SWAP, {"comments": [{"id": "c9", "verdict": "declined", "reason": "?"}]},
         CommentVerdict.APPLIED, "Fine."),
    ],
)  # fmt: skip
def test_comments_get_their_answers(
    rows: dict[int, list[int]], more: dict[str, Any], verdict: CommentVerdict, reason: str
) -> None:
    scene = hardware().saying("The Drone 21 should focus on tracking target 124.")
    proposal = accepted(task(scene).receive(plan(rows, **more), scene.snapshot()))
    (answer,) = proposal.comment_answers
    assert (answer.comment_id, answer.verdict, answer.reason) == ("c1", verdict, reason)
    assert proposal.considered == ("c1",)


def test_plain_lines_answer_comments_too() -> None:
    scene = hardware().saying("Swap, please.")
    call = task(scene, form=AnswerForm.LINES)
    text = (
        "Drone 21 should track Target 124.\nDrone 26 should track Target 122.\n"
        "Feedback to the human supervisor: Swapped."
    )
    proposal = accepted(call.receive(reply(text), scene.snapshot()))
    (answer,) = proposal.comment_answers
    assert (answer.verdict, answer.reason) == (CommentVerdict.APPLIED, "Swapped.")


def test_answered_comments_are_considered_but_not_answered_again() -> None:
    scene = hardware().saying("Swap, please.", "Faster!")
    first = replace(scene.receipts[0], task=CommentVerdict.APPLIED)
    scene = replace(scene, receipts=(first, scene.receipts[1]))
    proposal = accepted(task(scene).receive(plan(SAME), scene.snapshot()))
    assert proposal.considered == ("c1", "c2")
    assert [answer.comment_id for answer in proposal.comment_answers] == ["c2"]


def test_a_comment_that_came_in_between_is_considered_by_the_retry_only() -> None:
    before, after = hardware(), hardware().saying("Swap, please.")
    call = task(before)
    assert isinstance(call.receive(plan({}), after.snapshot()), Retry)
    proposal = accepted(call.receive(plan(SWAP), after.snapshot()))
    assert proposal.considered == ("c1",)
    untouched = task(before)
    proposal = accepted(untouched.receive(plan(SWAP), after.snapshot()))
    assert proposal.considered == ()
    assert proposal.comment_answers == ()


def test_nobody_else_comments_get_an_answer_when_none_was_accepted() -> None:
    scene = hardware().saying("Swap, please.")
    call = task(scene)
    outcomes = [call.receive(plan({}, **said("applied")), scene.snapshot()) for _ in range(3)]
    assert isinstance(outcomes[-1], GivenUp)


# ------------------------------------------------------------------ what counts as a change


@pytest.mark.parametrize(
    ("asked", "changed"),
    [
        (lambda p: p, False),
        (lambda p: replace(p, assignment=((21, (122,)), (26, (124,)))), False),
        (lambda p: replace(p, assignment=((21, (122, 124)), (26, (124,)))), True),
        (lambda p: replace(p, capacities=((21, 2),)), False),
        (lambda p: replace(p, capacities=((21, 1),)), True),
        (lambda p: replace(p, weights=tuple(WEIGHTS)), False),
        (lambda p: replace(p, weights=(10.004, 0.05, 50.0, 50.0)), False),
        (lambda p: replace(p, weights=(11.0, 0.05, 50.0, 50.0)), True),
        (lambda p: replace(p, severities=(("s1", 1.0),)), False),
        (lambda p: replace(p, severities=(("s1", 1.5),)), True),
        (lambda p: replace(p, replan=(21,)), True),
    ],
)
def test_changes(asked: Callable[[Proposal], Proposal], changed: bool) -> None:
    proposal = asked(Proposal("p", Source.OPERATOR, 0.0))
    assert changes(proposal, hardware().snapshot()) is changed
