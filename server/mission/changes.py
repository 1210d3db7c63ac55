"""How an accepted proposal becomes the directives in force."""

from dataclasses import replace

from llm.verification import assignment_of, keeps, pins_with
from solver.directives import (
    CommentVerdict,
    Directives,
    Pairing,
    Pin,
    Proposal,
    Source,
    Weights,
)
from solver.snapshot import CommentReceipt, Snapshot

_PINNING = (CommentVerdict.APPLIED, CommentVerdict.PARTLY)


def applied(
    directives: Directives,
    proposal: Proposal,
    now_s: float,
    receipts: tuple[CommentReceipt, ...],
) -> Directives:
    """Return the directives with an accepted proposal in force.

    What a comment newly brought about becomes a soft pin for as long as the comment stands,
    so that the next answers keep it. A person's own assignment ends the soft pins it breaks.
    """
    if proposal.pins_set or proposal.pins_lifted:
        directives = replace(directives, pins=pins_with(directives.pins, proposal))
    if proposal.assignment is not None:
        before, after = directives.assignment, assignment_of(proposal)
        standing = directives.pins
        if proposal.source is Source.OPERATOR:
            standing = tuple(p for p in standing if p.comment_id is None or keeps(after, p))
        pins = (*standing, *soft_pins(proposal, after - before, receipts))
        directives = replace(
            directives,
            assignment=after,
            pins=pins,
            assignment_source=proposal.source,
            assignment_since_s=now_s if after != before else directives.assignment_since_s,
        )
    if proposal.weights is not None:
        weights = Weights(*proposal.weights)
        directives = replace(
            directives,
            weights=weights,
            weights_source=proposal.source,
            weights_since_s=now_s if weights != directives.weights else directives.weights_since_s,
        )
    if proposal.capacities is not None:
        changed = dict(proposal.capacities)
        capacities = tuple((rid, changed.get(rid, cap)) for rid, cap in directives.capacities)
        directives = replace(directives, capacities=capacities)
    if proposal.severities is not None:
        severities = dict(directives.severities) | dict(proposal.severities)
        kept = tuple(sorted((zone, value) for zone, value in severities.items() if value != 1.0))
        directives = replace(directives, severities=kept)
    return directives


def assignment_proposal(
    name: str, source: Source, snapshot: Snapshot, pairs: frozenset[Pairing]
) -> Proposal:
    """Return the proposal that asks for exactly these pairs."""
    return Proposal(
        id=name,
        source=source,
        asked_s=snapshot.time_s,
        assignment=tuple(
            (robot_id, tuple(sorted(p.target_id for p in pairs if p.robot_id == robot_id)))
            for robot_id in snapshot.robots.ids
        ),
    )


def soft_pins(
    proposal: Proposal, added: frozenset[Pairing], receipts: tuple[CommentReceipt, ...]
) -> tuple[Pin, ...]:
    """Return pins for the pairs an applied comment added, on the newest such comment."""
    answered = {a.comment_id for a in proposal.comment_answers if a.verdict in _PINNING}
    causes = [r.comment for r in receipts if r.comment.id in answered and r.task not in _PINNING]
    if not causes:
        return ()
    cause = causes[-1]
    return tuple(
        Pin(
            id=f"{cause.id}-{pair.robot_id}-{pair.target_id}",
            pair=pair,
            expires_s=cause.time_s + cause.ttl_s,
            comment_id=cause.id,
        )
        for pair in sorted(added)
    )


def declined(proposal: Proposal, reason: str) -> Proposal:
    """Return a proposal whose comments are declined, since it does not come into force."""
    answers = tuple(
        replace(a, verdict=CommentVerdict.DECLINED, reason=reason) if a.verdict in _PINNING else a
        for a in proposal.comment_answers
    )
    return replace(proposal, comment_answers=answers)


def without_expired(directives: Directives, now_s: float) -> Directives:
    """Return the directives without the pins whose time is over."""
    kept = tuple(p for p in directives.pins if p.expires_s is None or now_s < p.expires_s)
    return directives if len(kept) == len(directives.pins) else replace(directives, pins=kept)


def without_zone(directives: Directives, zone_id: str) -> Directives:
    """Return the directives without the severity of a zone that is gone."""
    kept = tuple((zone, value) for zone, value in directives.severities if zone != zone_id)
    return replace(directives, severities=kept)
