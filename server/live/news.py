"""What is worth telling people between two snapshots, in plain words."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from server.encoding import EventKind, Severity
from solver.directives import Directives, Source
from solver.observations import HoldState, Link
from solver.problem import Rung
from solver.snapshot import CommentReceipt, Guidance, Snapshot, TrackStatus
from solver.zones import ZoneKind

SOURCES = {
    Source.SCENARIO: "the scenario",
    Source.TASK_LLM: "the task model",
    Source.ACTION_LLM: "the action model",
    Source.EXACT: "the assignment solver",
    Source.REPAIR: "the repair",
    Source.OPERATOR: "the operator",
}
_LINK_WORDS = {
    Link.CONNECTED: "is connected again",
    Link.JAMMED: "is silent but alive: communication failure",
    Link.LOST: "is lost",
}
_GUIDANCE_WORDS = {
    Guidance.MODEL: "by the models",
    Guidance.LAST_VALID: "by the last valid answer: the models have been silent",
    Guidance.SOLVER: "by our own assignment solver",
    Guidance.HOLD: "on hold",
}
_POOR = frozenset({Rung.SHIFTED, Rung.BRAKE})


@dataclass(frozen=True, slots=True)
class Item:
    """One piece of news."""

    kind: EventKind
    severity: Severity
    text: str
    data: dict[str, Any] = field(default_factory=dict)


def news(before: Snapshot | None, after: Snapshot) -> Iterator[Item]:
    """Yield what has happened from one snapshot to the next, in order of importance."""
    yield from _attacks(before, after)
    if before is None:
        return
    yield from _hold(before, after)
    yield from _robots(before, after)
    yield from _targets(before, after)
    yield from _assignment(before.directives, after.directives)
    yield from _weights(before.directives, after.directives)
    yield from _comments(before, after)
    yield from _guidance(before, after)


def _attacks(before: Snapshot | None, after: Snapshot) -> Iterator[Item]:
    known = set() if before is None else {zone.id for zone in before.zones}
    for attack in after.attacks:
        sensing = attack.kind is ZoneKind.SENSING
        what = "blinded" if sensing else "cut off"
        where = "an unknown zone" if attack.zone is None else f"zone {attack.zone.id}"
        new = attack.zone is not None and attack.zone.id not in known
        text = f"Robot {attack.robot_id} was {what} by {where}" + (
            ", which nobody knew before." if new else "."
        )
        data = {"robot": attack.robot_id, "kind": attack.kind.value}
        if attack.zone is not None:
            data["zone"] = attack.zone.id
            if new:
                data["new"] = True
            known.add(attack.zone.id)
        yield Item(EventKind.ATTACK, Severity.WARNING, text, data)


def _hold(before: Snapshot, after: Snapshot) -> Iterator[Item]:
    if before.hold is not after.hold:
        held = after.hold is HoldState.HELD
        yield Item(
            EventKind.HOLD,
            Severity.WARNING if held else Severity.INFO,
            "All robots hold." if held else "The team flies again.",
        )


def _robots(before: Snapshot, after: Snapshot) -> Iterator[Item]:
    old, new = before.robots, after.robots
    for i, robot_id in enumerate(new.ids):
        if old.links[i] is not new.links[i]:
            link = new.links[i]
            severity = {Link.CONNECTED: Severity.INFO, Link.JAMMED: Severity.WARNING}
            yield Item(
                EventKind.LINK,
                severity.get(link, Severity.ALARM),
                f"Robot {robot_id} {_LINK_WORDS[link]}.",
                {"robot": robot_id, "link": link.value},
            )
        if old.sensing_failed[i] and not new.sensing_failed[i]:
            yield Item(
                EventKind.RECOVERY,
                Severity.INFO,
                f"Robot {robot_id} sees again.",
                {"robot": robot_id},
            )


def _targets(before: Snapshot, after: Snapshot) -> Iterator[Item]:
    for i, target_id in enumerate(after.tracks.ids):
        old, new = before.tracks.status[i], after.tracks.status[i]
        data = {"target": target_id}
        if new is TrackStatus.DROPPED and old is not new:
            text = f"Target {target_id} is lost: nobody has seen it for too long."
            yield Item(EventKind.ALARM, Severity.ALARM, text, data)
        elif new is TrackStatus.TRACKED and old in (TrackStatus.DROPPED, TrackStatus.UNKNOWN):
            yield Item(EventKind.RECOVERY, Severity.INFO, f"Target {target_id} was found.", data)


def _assignment(before: Directives, after: Directives) -> Iterator[Item]:
    if before.assignment == after.assignment:
        return
    changes, old, new = [], before.rows(), after.rows()
    for robot_id, _ in after.capacities:
        targets = new.get(robot_id, ())
        if targets != old.get(robot_id, ()):
            words = ", ".join(str(target) for target in targets) or "no target"
            changes.append(f"robot {robot_id} tracks {words}")
    text = f"Assignment by {SOURCES[after.assignment_source]}: {'; '.join(changes)}."
    yield Item(
        EventKind.DIRECTIVES,
        Severity.INFO,
        text,
        {"what": "assignment", "source": after.assignment_source.value},
    )


def _weights(before: Directives, after: Directives) -> Iterator[Item]:
    changes = [
        f"{name} {old:g} to {new:g}"
        for name, old, new in zip(after.weights._fields, before.weights, after.weights, strict=True)
        if old != new
    ]
    severities = dict(before.severities)
    for zone_id, severity in after.severities:
        if severities.get(zone_id, 1.0) != severity:
            changes.append(f"severity of zone {zone_id} to {severity:g}")
    if changes:
        text = f"Weights by {SOURCES[after.weights_source]}: {', '.join(changes)}."
        data = {"what": "weights", "source": after.weights_source.value}
        yield Item(EventKind.DIRECTIVES, Severity.INFO, text, data)


def _comments(before: Snapshot, after: Snapshot) -> Iterator[Item]:
    old = {receipt.comment.id: receipt for receipt in _all_receipts(before)}
    for receipt in _all_receipts(after):
        comment = receipt.comment
        data = {"comment": comment.id, "status": receipt.status}
        if comment.id not in old:
            text = f"{comment.author.capitalize()}: {comment.text}"
            yield Item(EventKind.COMMENT, Severity.INFO, text, data)
        elif old[comment.id].status != receipt.status:
            reason = _reason(receipt)
            text = f"Comment {comment.id} {receipt.status.replace('_', ' ')}" + (
                f": {reason}" if reason else "."
            )
            yield Item(EventKind.COMMENT, Severity.INFO, text, data)


def _guidance(before: Snapshot, after: Snapshot) -> Iterator[Item]:
    if before.guidance is not after.guidance and after.guidance is not Guidance.HOLD:
        well = after.guidance is Guidance.MODEL or before.guidance is Guidance.HOLD
        yield Item(
            EventKind.LOOP,
            Severity.INFO if well else Severity.WARNING,
            f"The team is guided {_GUIDANCE_WORDS[after.guidance]}.",
            {"guidance": after.guidance.value},
        )
    poor = after.solve is not None and after.solve.rung in _POOR
    was_poor = before.solve is not None and before.solve.rung in _POOR
    if poor and not was_poor and after.solve is not None:
        text = f"The optimizer found no new plan; the team flies on rung {after.solve.rung.value}."
        yield Item(EventKind.ALARM, Severity.WARNING, text, {"rung": after.solve.rung.value})


def _reason(receipt: CommentReceipt) -> str:
    """Return the words of the loop that gave the receipt its status."""
    answers = ((receipt.task, receipt.task_reason), (receipt.action, receipt.action_reason))
    return next(
        (words for verdict, words in answers if verdict is not None and verdict == receipt.status),
        receipt.task_reason or receipt.action_reason,
    )


def _all_receipts(snapshot: Snapshot) -> tuple[CommentReceipt, ...]:
    return (*snapshot.closed, *snapshot.receipts)
