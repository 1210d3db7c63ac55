"""What becomes of a comment when several proposals answer it."""

from server.mission.changes import soft_pins
from server.mission.comments import CommentLedger
from solver.directives import CommentAnswer, CommentVerdict, Pairing, Proposal, Source
from solver.observations import Comment
from solver.snapshot import CommentReceipt

APPLIED, PARTLY = CommentVerdict.APPLIED, CommentVerdict.PARTLY
DECLINED, NOTED = CommentVerdict.DECLINED, CommentVerdict.NOTED


def proposal(name: str, verdict: CommentVerdict, source: Source = Source.TASK_LLM) -> Proposal:
    answer = CommentAnswer("c1", verdict, f"reason of {name}")
    return Proposal(name, source, asked_s=0.0, comment_answers=(answer,), feedback=f"says {name}")


def told(*proposals: Proposal) -> CommentReceipt:
    """The receipt after these proposals have answered, in this order."""
    ledger = CommentLedger()
    ledger.receive(Comment("c1", "Focus on target 4.", time_s=0.0, ttl_s=120.0))
    for one in proposals:
        ledger.answer(one)
    return ledger.standing()[0]


def test_the_receipt_names_the_decision_that_applied_the_comment() -> None:
    receipt = told(
        proposal("t1", DECLINED), proposal("t2", APPLIED), proposal("t3", NOTED),
        proposal("t4", APPLIED), proposal("t5", DECLINED),
    )  # fmt: skip
    assert (receipt.task, receipt.task_proposal) == (APPLIED, "t2")
    assert (receipt.task_reason, receipt.task_feedback) == ("reason of t2", "says t2")


def test_the_rest_of_a_comment_may_still_be_applied() -> None:
    receipt = told(proposal("t1", PARTLY), proposal("t2", DECLINED), proposal("t3", APPLIED))
    assert (receipt.task, receipt.task_proposal) == (APPLIED, "t3")
    assert told(proposal("t1", PARTLY), proposal("t2", PARTLY)).task_proposal == "t1"


def test_of_those_that_changed_nothing_the_newest_is_named() -> None:
    receipt = told(proposal("t1", DECLINED), proposal("t2", NOTED))
    assert (receipt.task, receipt.task_proposal) == (NOTED, "t2")


def test_each_loop_has_its_own_answer() -> None:
    receipt = told(proposal("t1", APPLIED), proposal("a1", DECLINED, Source.ACTION_LLM))
    assert (receipt.task, receipt.task_proposal) == (APPLIED, "t1")
    assert (receipt.action, receipt.action_proposal) == (DECLINED, "a1")


def test_what_a_comment_changed_is_pinned_by_the_proposal_that_applied_it() -> None:
    """A gate that refused an earlier one has let nothing of it happen."""
    added = frozenset({Pairing(0, 4)})
    again = proposal("t9", APPLIED)
    (pin,) = soft_pins(again, added, (told(proposal("t1", DECLINED)),))
    assert (pin.pair, pin.comment_id) == (Pairing(0, 4), "c1")
    assert soft_pins(again, added, (told(proposal("t1", APPLIED)),)) == ()
