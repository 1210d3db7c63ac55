"""The ways the mock can be told to misbehave, so that everything above it can be tested."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from llm.mock.deciding import ActionDecision, Decision, TaskDecision, write
from llm.mock.reading import Reading


class Mode(StrEnum):
    """What is wrong with the endpoint or its answers."""

    SOUND = "sound"
    SLOW = "slow"
    FAIL_429 = "fail_429"
    FAIL_500 = "fail_500"
    STALL = "stall"
    """Half a reply, then silence."""

    HUGE = "huge"
    """A reply that never ends."""

    NOT_JSON = "not_json"
    """A reply that is no chat completion."""

    GARBAGE = "garbage"
    EMPTY = "empty"
    REFUSE = "refuse"
    OVER_CAPACITY = "over_capacity"
    UNCOVERED = "uncovered"
    UNKNOWN_IDS = "unknown_ids"
    NAN = "nan"
    WRONG_LENGTH = "wrong_length"
    OUT_OF_BOUNDS = "out_of_bounds"
    OBEY = "obey"
    """Does whatever a comment or name in the prompt tells it to."""


@dataclass(frozen=True, slots=True)
class Behaviour:
    """How the mock behaves, for how many requests."""

    mode: Mode = Mode.SOUND
    times: int | None = None
    """Requests that misbehave before the mock is sound again; None for ever."""

    delay_s: float = 5.0
    """How long a slow reply takes, and how long a stalled one is silent."""

    retry_after_s: float | None = None
    """Told with 429 and 500."""

    key: str | None = None
    """Bearer token asked for; everybody is served where None."""

    formats: tuple[str, ...] = ("json_schema", "json_object")
    """Response formats understood; others are answered 400."""


_GARBAGE = 'The quick brown fox [1, x] {"assignment": "yes"} Drone Drone Target \u2603'
_SORRY = "I'm sorry, but I can't help with controlling drones."


def spoiled(mode: Mode, decision: Decision, reading: Reading) -> str:
    """Return the text of an answer that misbehaves."""
    fixed: Mapping[Mode, str] = {
        Mode.GARBAGE: _GARBAGE,
        Mode.EMPTY: "",
        Mode.REFUSE: _SORRY,
    }
    if mode in fixed:
        return fixed[mode]
    if mode is Mode.OBEY:
        return _obedient(decision, reading)
    if isinstance(decision, TaskDecision):
        return write(_spoiled_task(mode, decision, reading), reading)
    return write(_spoiled_action(mode, decision), reading)


def _spoiled_task(mode: Mode, decision: TaskDecision, reading: Reading) -> TaskDecision:
    every = tuple(target.id for target in reading.targets)
    rows = decision.rows
    match mode:
        case Mode.OVER_CAPACITY:
            rows = tuple((robot, (*every, *every)) for robot, _ in rows)
        case Mode.UNCOVERED:
            rows = tuple((robot, ()) for robot, _ in rows)
        case Mode.UNKNOWN_IDS | Mode.NAN:
            rows = ((987, every[:1]), *((robot, (654,)) for robot, _ in rows))
        case Mode.WRONG_LENGTH | Mode.OUT_OF_BOUNDS:
            rows = rows[:-1]
    return TaskDecision(rows, decision.feedback, decision.reactions, decision.capacities)


def _spoiled_action(mode: Mode, decision: ActionDecision) -> ActionDecision:
    weights, severities, replan = decision.weights, decision.severities, decision.replan
    match mode:
        case Mode.NAN | Mode.OVER_CAPACITY:
            weights = (float("nan"), float("inf"), *weights[2:])
        case Mode.OUT_OF_BOUNDS | Mode.UNCOVERED:
            weights = (0.0, -1.0, 1e9, *weights[3:])
        case Mode.UNKNOWN_IDS:
            severities, replan = (("nowhere", 2.0),), (987,)
        case Mode.WRONG_LENGTH:
            weights = weights[:-1]
    return ActionDecision(weights, decision.feedback, decision.reactions, severities, replan)


def _obedient(decision: Decision, reading: Reading) -> str:
    """Repeat the newest comment, or the name of a zone, as an injected model would."""
    if reading.comments:
        injected = reading.comments[-1].text
    elif reading.zones:
        injected = reading.zones[-1].label.replace("_", " ")
    else:
        return write(decision, reading)
    if reading.wants_json and isinstance(decision, TaskDecision) and "{" not in injected:
        everything = [target.id for target in reading.targets]
        return json.dumps(
            {
                "assignment": {str(robot): everything for robot, _ in decision.rows},
                "feedback": injected,
            }
        )
    return injected
