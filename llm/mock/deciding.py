"""What the mock decides, and how it writes it down: JSON or the paper's plain lines."""

import json
from dataclasses import dataclass

from llm.mock.reading import Reading


@dataclass(frozen=True, slots=True)
class Reaction:
    """The answer to one comment."""

    label: str
    verdict: str
    reason: str


@dataclass(frozen=True, slots=True)
class TaskDecision:
    """A new assignment."""

    rows: tuple[tuple[int, tuple[int, ...]], ...]
    feedback: str
    reactions: tuple[Reaction, ...] = ()
    capacities: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, slots=True)
class ActionDecision:
    """New weights."""

    weights: tuple[float, ...]
    feedback: str
    reactions: tuple[Reaction, ...] = ()
    severities: tuple[tuple[str, float], ...] = ()
    replan: tuple[int, ...] = ()


Decision = TaskDecision | ActionDecision

_NAMES = ("tracking", "control", "sensing", "communication")


def write(decision: Decision, reading: Reading) -> str:
    """Write a decision in the form the prompt asks for."""
    if reading.wants_json:
        return json.dumps(_as_json(decision, reading))
    return "\n".join(_as_lines(decision))


def _as_json(decision: Decision, reading: Reading) -> dict[str, object]:
    body: dict[str, object] = {}
    if isinstance(decision, TaskDecision):
        body["assignment"] = {str(robot): list(row) for robot, row in decision.rows}
        if "capacities" in reading.offers:
            body["capacities"] = [
                {"drone": robot, "capacity": capacity} for robot, capacity in decision.capacities
            ]
    else:
        weights = decision.weights
        named = len(weights) == len(_NAMES)
        body["weights"] = dict(zip(_NAMES, weights, strict=True)) if named else list(weights)
        if "severities" in reading.offers:
            body["severities"] = [
                {"zone": label, "severity": severity} for label, severity in decision.severities
            ]
        if "replan" in reading.offers:
            body["replan"] = list(decision.replan)
    body["feedback"] = decision.feedback
    if any(comment.new for comment in reading.comments):
        body["comments"] = [
            {"id": r.label, "verdict": r.verdict, "reason": r.reason} for r in decision.reactions
        ]
    return body


def _as_lines(decision: Decision) -> list[str]:
    if isinstance(decision, TaskDecision):
        lines = [
            f"Drone {robot} should track "
            + (" and ".join(f"Target {target}" for target in row) or "no target")
            + "."
            for robot, row in decision.rows
        ]
    else:
        lines = [f"[{', '.join(f'{weight:g}' for weight in decision.weights)}]"]
        lines += [f"Severity of zone {label}: {value:g}" for label, value in decision.severities]
        lines += [f"Replan Drone {robot}" for robot in decision.replan]
    lines += [
        f"Comment {r.label}: {r.verdict.replace('_', ' ')}, {r.reason}" for r in decision.reactions
    ]
    lines.append(f"Feedback to the human supervisor: {decision.feedback}")
    return lines
