"""Decision cards as JSON values and in plain words (docs/reference/cards.md)."""

import statistics
from collections import Counter
from collections.abc import Sequence
from typing import Any

from server.encoding import number
from server.gate.decisions import (
    Approval,
    Attempt,
    Changes,
    Decision,
    Effect,
    Fact,
    GateVerdict,
    Loop,
    Status,
)
from server.gate.keeper import Gatekeeper
from server.gate.merit import Merit

Json = dict[str, Any]

_SECONDS = 3
_FINE = 6

_WHO = {
    Loop.TASK: "The task model",
    Loop.ACTION: "The action model",
    Loop.SOLVER: "The assignment solver",
}


def decision_object(card: Decision) -> Json:
    """Return a card as JSON values; it needs nothing beside it to be understood."""
    verification = card.verification
    return {
        "id": card.id,
        "proposal": card.proposal_id,
        "loop": card.loop.value,
        "source": card.source.value,
        "author": card.author,
        "asked_s": number(card.asked_s, _SECONDS),
        "time_s": number(card.time_s, _SECONDS),
        "status": card.status.value,
        "refused_by": None if card.refused_by is None else card.refused_by.value,
        "reasons": list(card.reasons),
        "decided_s": number(card.decided_s, _SECONDS),
        "tries": card.tries,
        "changed": bool(card.changes),
        "changes": changes_object(card.changes),
        "facts": [_fact(fact) for fact in card.facts],
        "feedback": card.feedback,
        "verification": None
        if verification is None
        else {"accepted": verification.accepted, "violations": list(verification.violations)},
        "gate": None if card.gate is None else _gate(card.gate),
        "approval": None if card.approval is None else _approval(card.approval),
        "effect": None if card.effect is None else _effect(card.effect),
        "comments": list(card.comment_ids),
    }


def changes_object(changes: Changes) -> Json:
    """Return the differences: per robot what it gains and loses, per number old and new."""
    return {
        "assignment": [
            {"robot": row.robot_id, "gains": list(row.gains), "loses": list(row.loses)}
            for row in changes.assignment
        ],
        "weights": {name: [old, new] for name, old, new in changes.weights},
        "capacities": {str(robot): [old, new] for robot, old, new in changes.capacities},
        "severities": {zone: [old, new] for zone, old, new in changes.severities},
        "pins_set": [
            {
                "id": pin.id,
                "robot": pin.pair.robot_id,
                "target": pin.pair.target_id,
                "forbids": pin.forbids,
                "expires_s": number(pin.expires_s, _SECONDS),
            }
            for pin in changes.pins_set
        ],
        "pins_lifted": list(changes.pins_lifted),
        "replan": list(changes.replan),
    }


def with_decisions(
    result: Json, keeper: Gatekeeper, forecasts_s: Sequence[float], since_s: float = 0.0
) -> Json:
    """Return a mission's result with how its proposals fared, and every kept card.

    `forecasts_s` are the thread times of the predictions; `since_s` is the mission time from which
    the keeper has kept cards.
    """
    cards = keeper.cards()
    changed = [card for card in cards if card.changes]
    refused = Counter(card.refused_by.value for card in cards if card.refused_by is not None)
    times_ms = sorted(1e3 * spent for spent in forecasts_s)
    gate = {
        "mode": keeper.mode.value,
        "since_s": since_s,
        "proposals": len(cards),
        "changing": len(changed),
        "gone_into_force": sum(card.accepted for card in changed),
        "refused": dict(sorted(refused.items())),
        "forecasts": len(times_ms),
        "forecast_median_ms": statistics.median(times_ms) if times_ms else None,
        "forecast_max_ms": times_ms[-1] if times_ms else None,
    }
    return {**result, "gate": gate, "decisions": [decision_object(card) for card in cards]}


def exchange_object(decision_id: str, attempts: tuple[Attempt, ...]) -> Json:
    """Return the prompts and raw answers behind a card."""
    return {
        "id": decision_id,
        "attempts": [
            {"prompt": each.prompt, "answer": each.answer, "reasons": list(each.reasons)}
            for each in attempts
        ],
    }


def decision_words(card: Decision) -> str:
    """Return a card in one sentence or two, for the list of events."""
    who = _WHO.get(card.loop, card.author.capitalize() or "Somebody")
    effect = card.effect
    if effect is not None and effect.realised_merit is not None:
        return (
            f"{card.id}: predicted a merit of {effect.predicted_merit:.3f} m² over "
            f"{effect.until_s - effect.from_s:g} s, it became {effect.realised_merit:.3f} m²."
        )
    what = changes_words(card.changes)
    if card.status is Status.PENDING:
        end = "waits for approval"
    elif card.status is Status.REFUSED:
        end = f"refused ({card.refused_by}): {'; '.join(card.reasons)}"
    elif not card.changes:
        end = "nothing changes"
    else:
        end = "adopted"
    gate = "" if card.gate is None or not card.changes else f" {card.gate.reason}"
    return f"{card.id}: {who}{f', {what}' if what else ''}: {end}.{gate}".replace("..", ".")


def changes_words(changes: Changes) -> str:
    """Return the differences in plain words."""
    parts = []
    for row in changes.assignment:
        gains = [f"gains {', '.join(map(str, row.gains))}"] if row.gains else []
        loses = [f"gives up {', '.join(map(str, row.loses))}"] if row.loses else []
        parts.append(f"robot {row.robot_id} {' and '.join(gains + loses)}")
    parts += [f"{name} {old:g} to {new:g}" for name, old, new in changes.weights]
    parts += [f"capacity of robot {r} {old} to {new}" for r, old, new in changes.capacities]
    parts += [f"severity of zone {z} {old:g} to {new:g}" for z, old, new in changes.severities]
    for pin in changes.pins_set:
        verb = "kept apart" if pin.forbids else "pinned"
        parts.append(f"robot {pin.pair.robot_id} and target {pin.pair.target_id} {verb}")
    parts += [f"pin {pin_id} lifted" for pin_id in changes.pins_lifted]
    parts += [f"robot {robot} starts afresh" for robot in changes.replan]
    return "; ".join(parts)


def merit_object(merit: Merit) -> Json:
    """Return the parts of a window's merit."""
    return {
        "seconds": number(merit.seconds, _SECONDS),
        "trace": number(merit.trace, _FINE),
        "sensing_hits": number(merit.sensing_hits, _FINE),
        "communication_hits": number(merit.communication_hits, _FINE),
        "effort": number(merit.effort, _FINE),
    }


def _fact(fact: Fact) -> Json:
    return {
        "kind": fact.kind.value,
        "text": fact.text,
        "robot": fact.robot_id,
        "zone": fact.zone_id,
        "comment": fact.comment_id,
        "value": number(fact.value, _FINE),
        "time_s": number(fact.time_s, _SECONDS),
    }


def _gate(gate: GateVerdict) -> Json:
    return {
        "mode": gate.mode.value,
        "judgement": gate.judgement.value,
        "reason": gate.reason,
        "horizon_s": number(gate.horizon_s, _SECONDS),
        "in_force": None if gate.in_force is None else merit_object(gate.in_force),
        "proposed": None if gate.proposed is None else merit_object(gate.proposed),
        "difference_m2": number(gate.difference, _FINE),
        "margin_m2": number(gate.margin, _FINE),
    }


def _approval(approval: Approval) -> Json:
    return {
        "asked_s": number(approval.asked_s, _SECONDS),
        "expires_s": number(approval.expires_s, _SECONDS),
        "approved": approval.approved,
        "by": approval.by,
    }


def _effect(effect: Effect) -> Json:
    realised = effect.realised
    return {
        "from_s": number(effect.from_s, _SECONDS),
        "until_s": number(effect.until_s, _SECONDS),
        "predicted": merit_object(effect.predicted),
        "predicted_merit_m2": number(effect.predicted_merit, _FINE),
        "realised": None if realised is None else merit_object(realised),
        "realised_merit_m2": number(effect.realised_merit, _FINE),
        "overlapped_by": list(effect.overlapped_by),
    }
