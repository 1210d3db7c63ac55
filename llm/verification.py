"""Whether a proposal may become directives (paper, section III-C, eq. 4, and III-D).

A whole answer is accepted or refused; it is never patched. Every violation is a sentence
that can be told to a model or a person. The same function judges people's overrides.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Self

from llm import words
from llm.coverage import Shortfall, Team, shortfall, standing_pins
from llm.quoting import label, labels
from solver.directives import Pairing, Pin, Proposal, Source, Verdict, Weights
from solver.observations import Link
from solver.snapshot import Snapshot

WEIGHT_NAMES = Weights._fields
PROMPT_ROUNDING = 1e-3
"""Relative: a severity repeated as the prompt wrote it is not lowered."""

_ASSIGNS = frozenset({Source.TASK_LLM, Source.EXACT, Source.REPAIR, Source.OPERATOR})
_WEIGHS = frozenset({Source.ACTION_LLM, Source.OPERATOR})


@dataclass(frozen=True, slots=True)
class Limits:
    """What no proposal may leave, whoever makes it."""

    weights_lower: Weights
    weights_upper: Weights
    severity_lower: float = 1.0
    severity_upper: float = 5.0
    capacities_upper: tuple[tuple[int, int], ...] = ()
    """(robot id, most targets anybody may allow it); the number of targets for the rest."""

    @classmethod
    def around(cls, weights: Weights, factor: float = 10.0) -> Self:
        """Return bounds of [1/factor, factor] times the scenario's weights."""
        return cls(
            weights_lower=Weights(*(w / factor for w in weights)),
            weights_upper=Weights(*(w * factor for w in weights)),
        )


def beta(
    assignment: Iterable[Pairing],
    snapshot: Snapshot,
    capacities: Mapping[int, int] | None = None,
) -> int:
    """Return the paper's beta(A): rows above capacity plus targets left without a robot.

    A lost robot has capacity 0; a jammed one counts with its frozen row; one in sensing
    failure gives no cover where another robot can. Targets that no robot has room for are
    not counted, so 0 can always be reached.

    Args:
        assignment: The ones of A.
        snapshot: The team, its failures and the pins in force.
        capacities: Most targets per robot, the directives' where None.
    """
    team = Team.of(snapshot, capacities)
    return shortfall(assignment, team, standing_pins(snapshot, team)).beta


def assignment_of(proposal: Proposal) -> frozenset[Pairing]:
    """Return the ones of the proposed A; empty where no assignment is proposed."""
    return frozenset(
        Pairing(robot_id, target_id)
        for robot_id, target_ids in proposal.assignment or ()
        for target_id in target_ids
    )


def with_frozen_rows(
    rows: tuple[tuple[int, tuple[int, ...]], ...], snapshot: Snapshot
) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """Add the rows of jammed robots that an answer left out, as the prompt invites it to."""
    named = {robot_id for robot_id, _ in rows}
    team = Team.of(snapshot)
    missing = tuple(
        (robot_id, tuple(sorted(row)))
        for robot_id, row in team.frozen.items()
        if robot_id not in named
    )
    return rows + missing


def verify(proposal: Proposal, snapshot: Snapshot, limits: Limits) -> Verdict:
    """Judge a proposal against the snapshot at its arrival.

    Args:
        proposal: What was asked for; ids and numbers may be wrong.
        snapshot: The team as it is now: robots and targets that went meanwhile count.
        limits: Bounds of weights, severities and capacities.
    """
    violations: list[str] = []
    violations.extend(_authority(proposal))
    if proposal.source is Source.OPERATOR:
        snapshot = _for_people(proposal, snapshot)
        violations.extend(_pins(proposal, snapshot))
    violations.extend(_capacities(proposal, snapshot, limits))
    capacities = dict(snapshot.directives.capacities)
    if not violations:
        capacities.update(proposal.capacities or ())
    violations.extend(_assignment(proposal, snapshot, capacities))
    violations.extend(_weights(proposal.weights, limits))
    violations.extend(_severities(proposal, snapshot, limits))
    violations.extend(_replan(proposal.replan, snapshot))
    return Verdict(proposal.id, tuple(dict.fromkeys(violations)))


def _authority(proposal: Proposal) -> Iterator[str]:
    asks_task = proposal.assignment is not None or proposal.capacities is not None
    if asks_task and proposal.source not in _ASSIGNS:
        yield "Assignments and capacities are not yours to change."
    asks_action = proposal.weights is not None or bool(proposal.severities or proposal.replan)
    if asks_action and proposal.source not in _WEIGHS:
        yield "Weights, severities and replanning are not yours to change."
    if (proposal.pins_set or proposal.pins_lifted) and proposal.source is not Source.OPERATOR:
        yield "Pins are not yours to set or lift."


def pins_with(pins: tuple[Pin, ...], proposal: Proposal) -> tuple[Pin, ...]:
    """Return the pins with those that a proposal sets or lifts; a pin set again is the newest."""
    gone = {pin.id for pin in proposal.pins_set} | set(proposal.pins_lifted)
    return (*(pin for pin in pins if pin.id not in gone), *proposal.pins_set)


def keeps(assignment: frozenset[Pairing], pin: Pin) -> bool:
    """Return whether an assignment does what a pin wants."""
    return (pin.pair in assignment) is not pin.forbids


def _for_people(proposal: Proposal, snapshot: Snapshot) -> Snapshot:
    """Return the snapshot as a person's own proposal is judged: with the pins it asks for.

    What a comment once brought about does not bind the people who say it in person.
    """
    pins = pins_with(snapshot.directives.pins, proposal)
    if proposal.assignment is not None:
        wanted = assignment_of(proposal)
        pins = tuple(pin for pin in pins if pin.comment_id is None or keeps(wanted, pin))
    return replace(snapshot, directives=replace(snapshot.directives, pins=pins))


def _pins(proposal: Proposal, snapshot: Snapshot) -> Iterator[str]:
    team = Team.of(snapshot)
    standing = {pin.id for pin in standing_pins(snapshot, team)}
    for pin in proposal.pins_set:
        robot_id, target_id = pin.pair
        if robot_id not in team.links:
            yield f"There is no Drone {robot_id}; the drones are {_ids(team.links)}."
        elif target_id in team.dropped:
            yield f"Target {target_id} is no longer tracked by anybody, so it cannot be pinned."
        elif target_id not in team.targets:
            yield f"There is no Target {target_id}; the targets are {_ids(team.targets)}."
        elif team.links[robot_id] is not Link.CONNECTED:
            yield f"Drone {robot_id} cannot be reached, so it cannot be pinned."
        elif pin.id not in standing:
            yield (
                f"Drone {robot_id} cannot be pinned to Target {target_id}: it can track at most "
                f"{team.capacities[robot_id]}, and other pins stand."
            )


def _repeated(values: Iterable[int] | Iterable[str]) -> tuple[str, ...]:
    counts = Counter(str(value) for value in values)
    return tuple(value for value, times in counts.items() if times > 1)


def _capacities(proposal: Proposal, snapshot: Snapshot, limits: Limits) -> Iterator[str]:
    asked = proposal.capacities
    if asked is None:
        return
    team = Team.of(snapshot)
    ceilings = dict(limits.capacities_upper)
    yield from (
        f"The capacity of Drone {robot_id} is given twice."
        for robot_id in _repeated(robot_id for robot_id, _ in asked)
    )
    valid = True
    for robot_id, capacity in asked:
        if robot_id not in team.links:
            valid = False
            yield f"There is no Drone {robot_id}, so it has no capacity."
            continue
        highest = min(ceilings.get(robot_id, len(snapshot.tracks.ids)), len(snapshot.tracks.ids))
        if not 0 <= capacity <= highest:
            valid = False
            yield (
                f"The capacity of Drone {robot_id} must be between 0 and {highest}, not {capacity}."
            )
    if valid and proposal.source is not Source.OPERATOR:
        yield from _idling(dict(asked), snapshot, team)


def _idling(asked: Mapping[int, int], snapshot: Snapshot, team: Team) -> Iterator[str]:
    """Capacities may not be lowered as a way around the duty to cover the targets."""
    current = shortfall((), team, standing_pins(snapshot, team))
    lowered_team = Team.of(snapshot, {**dict(snapshot.directives.capacities), **asked})
    lowered = shortfall((), lowered_team, standing_pins(snapshot, lowered_team))
    if lowered.allowed_uncovered > current.allowed_uncovered or (
        lowered.allowed_unsighted > current.allowed_unsighted
    ):
        yield "These capacities would leave targets without a drone that could have one."


def _assignment(
    proposal: Proposal, snapshot: Snapshot, capacities: Mapping[int, int]
) -> Iterator[str]:
    rows = proposal.assignment
    if rows is None:
        return
    team = Team.of(snapshot, capacities)
    yield from _identities(rows, team)
    live = set(team.targets)
    assignment = frozenset(
        pair
        for pair in assignment_of(proposal)
        if pair.robot_id in team.links and pair.target_id in live
    )
    yield from _frozen_rows(assignment, team)
    pins = standing_pins(snapshot, team)
    yield from _coverage(shortfall(assignment, team, pins), team)
    for pin in pins:
        if pin.forbids and pin.pair in assignment:
            yield f"Drone {pin.pair.robot_id} must not track Target {pin.pair.target_id}: " + (
                _reason(pin.comment_id)
            )
        elif not pin.forbids and pin.pair not in assignment:
            yield f"Drone {pin.pair.robot_id} must keep Target {pin.pair.target_id}: " + (
                _reason(pin.comment_id)
            )


def _reason(comment_id: str | None) -> str:
    if comment_id is None:
        return "the operator fixed it."
    return "a comment of the human supervisor that still stands asked for it."


def _identities(rows: tuple[tuple[int, tuple[int, ...]], ...], team: Team) -> Iterator[str]:
    yield from (
        f"Drone {robot_id} is named twice; give each drone once."
        for robot_id in _repeated(robot_id for robot_id, _ in rows)
    )
    for robot_id, target_ids in rows:
        if robot_id not in team.links:
            yield f"There is no Drone {robot_id}; the drones are {_ids(team.links)}."
        elif team.links[robot_id] is Link.LOST and target_ids:
            yield f"Drone {robot_id} is lost and can track no target."
        yield from (
            f"Drone {robot_id} is given Target {target_id} twice."
            for target_id in _repeated(target_ids)
        )
        for target_id in target_ids:
            if target_id in team.dropped:
                yield f"Target {target_id} is no longer tracked by anybody; leave it out."
            elif target_id not in team.targets:
                yield f"There is no Target {target_id}; the targets are {_ids(team.targets)}."


def _ids(ids: Iterable[int]) -> str:
    return words.listed([str(value) for value in ids])


def _frozen_rows(assignment: frozenset[Pairing], team: Team) -> Iterator[str]:
    for robot_id, row in team.frozen.items():
        given = {pair.target_id for pair in assignment if pair.robot_id == robot_id}
        if given != row:
            kept = words.targets(sorted(row)) if row else "no target"
            yield (
                f"Drone {robot_id} is cut off and cannot be reached, so it keeps {kept}: "
                "leave it out or repeat that."
            )


def _coverage(short: Shortfall, team: Team) -> Iterator[str]:
    for robot_id, given in short.overloaded:
        able = team.capacities[robot_id]
        if team.links[robot_id] is not Link.LOST:
            yield (f"Drone {robot_id} has {given} {_targets(given)} but can track at most {able}.")
    if short.excess_uncovered:
        yield (
            f"{words.targets(short.uncovered)} {_are(short.uncovered)} tracked by no drone; "
            f"{_allowance(short.allowed_uncovered)}."
        )
    elif short.excess_unsighted:
        yield (
            f"{words.targets(short.unsighted)} {_are(short.unsighted)} tracked by no drone that "
            "can see; drones without a sensing failure have room for "
            f"{short.excess_unsighted} more."
        )


def _are(ids: tuple[int, ...]) -> str:
    return "is" if len(ids) == 1 else "are"


def _targets(count: int) -> str:
    return "target" if count == 1 else "targets"


def _allowance(allowed: int) -> str:
    if allowed == 0:
        return "each target must be tracked by at least one drone"
    verb = "has" if allowed == 1 else "have"
    return f"only {allowed} {_targets(allowed)} {verb} to stay without one for want of capacity"


def _weights(weights: tuple[float, ...] | None, limits: Limits) -> Iterator[str]:
    if weights is None:
        return
    if len(weights) != len(WEIGHT_NAMES):
        yield f"There must be exactly 4 weights, not {len(weights)}."
        return
    bounds = zip(WEIGHT_NAMES, weights, limits.weights_lower, limits.weights_upper, strict=True)
    for index, (name, weight, lower, upper) in enumerate(bounds, start=1):
        if not math.isfinite(weight):
            yield f"Weight {index} ({name}) is not a finite number."
        elif not lower <= weight <= upper:
            yield (
                f"Weight {index} ({name}) must be between {words.at_least(lower)} and "
                f"{words.at_most(upper)}, not {weight:.10g}."
            )


def _severities(proposal: Proposal, snapshot: Snapshot, limits: Limits) -> Iterator[str]:
    asked = proposal.severities or ()
    known = labels(zone.id for zone in snapshot.zones)
    yield from (
        f"The severity of zone {known.get(zone_id, label(zone_id))} is given twice."
        for zone_id in _repeated(zone_id for zone_id, _ in asked)
    )
    for zone_id, severity in asked:
        name = known.get(zone_id, label(zone_id))
        if zone_id not in known:
            yield f"No zone {name} is known."
        elif not math.isfinite(severity):
            yield f"The severity of zone {name} is not a finite number."
        elif not limits.severity_lower <= severity <= limits.severity_upper:
            yield (
                f"The severity of zone {name} must be between "
                f"{words.at_least(limits.severity_lower)} and "
                f"{words.at_most(limits.severity_upper)}, not {severity:.10g}."
            )
        else:
            now = snapshot.directives.severity_of(zone_id)
            if severity < now * (1.0 - PROMPT_ROUNDING) and proposal.source is not Source.OPERATOR:
                yield (
                    f"The severity of zone {name} is {words.number(now)}; only an operator "
                    "may lower it."
                )


def _replan(robot_ids: tuple[int, ...], snapshot: Snapshot) -> Iterator[str]:
    links = dict(zip(snapshot.robots.ids, snapshot.robots.links, strict=True))
    yield from (f"Drone {robot_id} is to be replanned twice." for robot_id in _repeated(robot_ids))
    for robot_id in robot_ids:
        if robot_id not in links:
            yield f"There is no Drone {robot_id} to replan."
        elif links[robot_id] is not Link.CONNECTED:
            yield f"Drone {robot_id} cannot be reached, so it cannot be replanned."
