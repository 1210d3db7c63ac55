"""What the mock decides, and how it writes it down: JSON or the paper's plain lines."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

from llm.mock.reading import Reading


@dataclass(frozen=True, slots=True)
class Reaction:
    """The answer to one comment."""

    label: str
    verdict: str
    reason: str


def combined(label: str, parts: Sequence[Reaction]) -> Reaction:
    """Return one answer to a comment that asks for several things."""
    verdicts = {part.verdict for part in parts}
    done = verdicts & {"applied", "partly_applied"}
    if "declined" in verdicts or "partly_applied" in verdicts:
        verdict = "partly_applied" if done else "declined"
    else:
        verdict = "applied" if done else "noted"
    # What was noted says little beside what was done or declined.
    weighty = [part.reason for part in parts if part.verdict != "noted"]
    reasons = weighty or [part.reason for part in parts]
    return Reaction(label, verdict, " ".join(dict.fromkeys(reasons)))


FOREIGN_WORDS = "I understand English only; please say it in English. Nothing was changed for it."


def unknown_words(reading: Reading, robot_ids: Sequence[int], target_ids: Sequence[int]) -> str:
    """Say which of the robots and targets that a comment names do not exist; "" for none."""
    robots, targets = {r.id for r in reading.robots}, {t.id for t in reading.targets}
    missing = [f"Drone {r}" for r in robot_ids if r not in robots]
    missing += [f"Target {t}" for t in target_ids if t not in targets]
    return f"There is no {' and no '.join(missing)}." if missing else ""


def unclear_words(words: str) -> str:
    """Say what was not understood."""
    return f"I did not understand {json.dumps(words, ensure_ascii=False)}."


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

NAMES = ("tracking", "control", "sensing", "communication")
"""Of the weights, in the paper's order."""


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
        named = len(weights) == len(NAMES)
        body["weights"] = dict(zip(NAMES, weights, strict=True)) if named else list(weights)
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
        ] or ["No drone can be given a target."]
    else:
        lines = [f"[{', '.join(f'{weight:g}' for weight in decision.weights)}]"]
        lines += [f"Severity of zone {label}: {value:g}" for label, value in decision.severities]
        lines += [f"Replan Drone {robot}" for robot in decision.replan]
    lines += [
        f"Comment {r.label}: {r.verdict.replace('_', ' ')}, {r.reason}" for r in decision.reactions
    ]
    lines.append(f"Feedback to the human supervisor: {decision.feedback}")
    return lines
