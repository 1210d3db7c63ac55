"""What a decision card cites: the state of the team that a proposal was made from.

The trace always; comments that stood in the prompt; failures; and of zones and attacks those
that concern the robots it changes, or that its own words name.
"""

import re
from collections.abc import Iterable, Iterator

from llm.facts import condition, zone_labels
from server.gate.decisions import Changes, Fact, FactKind
from solver.directives import Proposal
from solver.observations import Attack, Link
from solver.snapshot import Snapshot

MOST_FACTS = 24
"""Per card."""

_ROBOT_WORD = re.compile(r"\b(?:drone|robot)s?\s+(\d+)", re.IGNORECASE)


def cited(
    proposal: Proposal, changes: Changes, snapshot: Snapshot, attacks: Iterable[Attack]
) -> tuple[Fact, ...]:
    """Return the facts of a card.

    Args:
        proposal: What was asked for; its feedback is searched for names.
        changes: What it makes different.
        snapshot: The team at its arrival.
        attacks: The last hit of each robot, lately.
    """
    robots = {row.robot_id for row in changes.assignment}
    robots |= {robot_id for robot_id, _, _ in changes.capacities} | set(changes.replan)
    robots |= {int(name) for name in _ROBOT_WORD.findall(proposal.feedback)}
    facts = [
        Fact(FactKind.TRACE, f"The trace is {snapshot.trace:.4f} m².", value=snapshot.trace),
        *_comments(proposal, snapshot),
        *_failures(snapshot),
        *_attacks(attacks, robots),
        *_zones(proposal, changes, snapshot),
    ]
    return tuple(facts[:MOST_FACTS])


def _comments(proposal: Proposal, snapshot: Snapshot) -> Iterator[Fact]:
    for receipt in snapshot.receipts:
        comment = receipt.comment
        if comment.id in proposal.considered:
            yield Fact(
                FactKind.COMMENT,
                f"{comment.author.capitalize()} said: {comment.text}",
                comment_id=comment.id,
                time_s=comment.time_s,
            )


def _failures(snapshot: Snapshot) -> Iterator[Fact]:
    robots = snapshot.robots
    for i, robot_id in enumerate(robots.ids):
        blind = bool(robots.sensing_failed[i])
        if blind or robots.links[i] is not Link.CONNECTED:
            what = condition(robots.links[i], blind=blind)
            yield Fact(FactKind.FAILURE, f"Robot {robot_id} is {what}.", robot_id=robot_id)


def _attacks(attacks: Iterable[Attack], robots: set[int]) -> Iterator[Fact]:
    for attack in attacks:
        if robots and attack.robot_id not in robots:
            continue
        zone = None if attack.zone is None else attack.zone.id
        where = "" if zone is None else f" by zone {zone}"
        yield Fact(
            FactKind.ATTACK,
            f"Robot {attack.robot_id} was hit{where} ({attack.kind}).",
            robot_id=attack.robot_id,
            zone_id=zone,
            time_s=attack.time_s,
        )


def _zones(proposal: Proposal, changes: Changes, snapshot: Snapshot) -> Iterator[Fact]:
    changed = {zone_id for zone_id, _, _ in changes.severities}
    labels = zone_labels(snapshot)
    for zone in snapshot.zones:
        named = any(
            re.search(rf"(?<!\w){re.escape(name)}(?!\w)", proposal.feedback)
            for name in {zone.id, labels[zone.id]}
        )
        if zone.id in changed or named:
            severity = snapshot.directives.severity_of(zone.id)
            text = f"Zone {zone.id} ({zone.kind}) is known, severity {severity:g}."
            yield Fact(FactKind.ZONE, text, zone_id=zone.id, value=severity)
