"""Decision cards of the scripted mission: whole, as a real mission tells them."""

from dataclasses import replace
from typing import Any

from server.gate.decisions import (
    Approval,
    Attempt,
    Changes,
    Decision,
    Effect,
    Fact,
    FactKind,
    GateVerdict,
    Judgement,
    Loop,
    Refuser,
    RowChange,
    Status,
)
from server.gate.encoding import decision_object, exchange_object
from server.gate.merit import Merit
from server.mission.setup import GateMode
from solver.directives import Source, Verdict
from solver.observations import Comment
from tests.server.scripted_directing import NOTHING

APPROVAL_S = 60.0
IN_FORCE = Merit(5.0, 3.1, 0.02, 0.0, 0.4)
PROPOSED = Merit(5.0, 2.4, 0.01, 0.0, 0.5)
SWAP = Changes(assignment=(RowChange(21, (122,), (125,)), RowChange(26, (125,), (122,))))


def override_card(number: int, time_s: float, author: str, changes: Any) -> dict[str, Any]:
    """Return the card of what a person did in person."""
    decision = Decision(
        id=f"d{number}",
        proposal_id=f"p{number}",
        loop=Loop.PEOPLE,
        source=Source.OPERATOR,
        author=author,
        asked_s=time_s,
        time_s=time_s,
        status=Status.ADOPTED,
        decided_s=time_s,
        verification=Verdict(f"p{number}"),
    )
    return decision_object(decision) | {"changes": changes, "changed": changes != NOTHING}


def proposed(number: int, comment: Comment, time_s: float, mode: GateMode) -> Decision:
    """Return what the task model makes of a comment: robots 21 and 26 swap a target."""
    waits = mode is GateMode.CONFIRM
    decision = Decision(
        id=f"d{number}",
        proposal_id=f"task-{comment.id}",
        loop=Loop.TASK,
        source=Source.TASK_LLM,
        author="task model",
        asked_s=time_s,
        time_s=time_s,
        status=Status.PENDING,
        changes=SWAP,
        facts=(
            Fact(FactKind.TRACE, "The trace is 0.6500 m².", value=0.65),
            Fact(FactKind.COMMENT, f"Operator said: {comment.text}", comment_id=comment.id),
            Fact(FactKind.FAILURE, "Robot 26 is blind.", robot_id=26),
        ),
        feedback="Drone 21 looks after target 122 from now on.",
        verification=Verdict(f"task-{comment.id}"),
        gate=GateVerdict(
            mode=mode,
            judgement=Judgement.BETTER,
            reason="The merit is predicted 0.142 m² better over 5 s.",
            horizon_s=5.0,
            in_force=IN_FORCE,
            proposed=PROPOSED,
            difference=-0.142,
            margin=0.05,
        ),
        comment_ids=(comment.id,),
    )
    if waits:
        return replace(decision, approval=Approval(time_s, time_s + APPROVAL_S))
    return adopted(decision, time_s)


def adopted(decision: Decision, time_s: float, by: str = "") -> Decision:
    """Return a decision that went into force, with what it will be measured by."""
    return replace(
        decision,
        status=Status.ADOPTED,
        decided_s=time_s,
        approval=_answered(decision.approval, by, approved=True),
        effect=Effect(time_s, time_s + 5.0, PROPOSED, 0.48),
    )


def refused(decision: Decision, time_s: float, by: str) -> Decision:
    """Return a decision that a person refused."""
    return replace(
        decision,
        status=Status.REFUSED,
        refused_by=Refuser.PERSON,
        reasons=(f"{by.capitalize()} refused it.",),
        decided_s=time_s,
        approval=_answered(decision.approval, by, approved=False),
    )


def exchange(decision: Decision) -> dict[str, Any]:
    """Return the prompt and the answer behind a decision, as a mission tells them."""
    attempt = Attempt(
        "[system]\nYou assign targets.\n\n[user]\n<script>alert('prompt')</script>",
        "Drone 21 should track Target 121 and Target 122.",
        (),
    )
    return {"type": "exchange", **exchange_object(decision.id, (attempt,))}


def _answered(approval: Approval | None, by: str, *, approved: bool) -> Approval | None:
    return None if approval is None else replace(approval, approved=approved, by=by)
