"""What a model said, read tolerantly: JSON or the paper's plain lines, prose around either.

Reading never judges. Ids and numbers are passed on as said, so that the verification can
tell what is wrong with them; only an answer without any assignment or weights is an error.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from llm import sentences, words
from llm.extraction import Pairs, json_objects, without_thoughts
from llm.sentences import Rows
from solver.directives import CommentVerdict, Weights

LONGEST_FEEDBACK = 1000
"""Characters kept of what a model says to people, or of one comment."""

_NOT_AN_ID = -1
"""Stands for an id that is no number; no robot or target has it, so it is refused."""

_WEIGHT_KEYS = Weights._fields
_MEANT_AS_JSON = re.compile(r"\{\s*\"")
_NOBODY = re.compile(r"^[^\w\n]{0,20}no (?:drone|robot)s?\b", re.I | re.M)
"""Said where no drone is left: "No drone can be given a target."."""

_REFUSAL = re.compile(
    r"\b(?:I['’]?m sorry|I am sorry|I apologi[sz]e|(?:I|we) (?:can['’]?t|cannot|can not|could not|"
    r"couldn['’]t|won['’]?t|will not|must not) (?:\w+ ){0,2}(?:help|assist|comply|provide|do|"
    r"answer|fulfil\w*|support|participate|take part|control|assign|engage|continue|advise)|"
    r"(?:I['’]m|I am|we are) (?:unable|not able|not allowed|not permitted)|"
    r"as an? (?:AI|large language model|language model)|I (?:must|have to) (?:decline|refuse)|"
    r"I (?:decline|refuse)|cannot fulfil|against (?:my|our) (?:guidelines|policy|policies)|"
    r"not something I can)",
    re.I,
)


class AnswerError(Exception):
    """Raised when an answer holds nothing to verify. Its text can be told to the model."""


@dataclass(frozen=True, slots=True)
class SaidOfComment:
    """A model's answer to one comment, by the comment's label in the prompt."""

    label: str
    verdict: CommentVerdict
    reason: str


@dataclass(frozen=True, slots=True)
class TaskAnswer:
    """What the task model said."""

    assignment: Rows
    capacities: tuple[tuple[int, int], ...] = ()
    feedback: str = ""
    comments: tuple[SaidOfComment, ...] = ()


@dataclass(frozen=True, slots=True)
class ActionAnswer:
    """What the action model said. Zones by their labels in the prompt."""

    weights: tuple[float, ...]
    severities: tuple[tuple[str, float], ...] = ()
    replan: tuple[int, ...] = ()
    feedback: str = ""
    comments: tuple[SaidOfComment, ...] = ()


def read_task(text: str) -> TaskAnswer:
    """Read a task answer.

    Raises:
        AnswerError: when it holds no assignment.
    """
    plain = without_thoughts(text)
    for found in json_objects(plain):
        rows = _json_rows(found)
        if rows is not None:
            return TaskAnswer(
                assignment=rows,
                capacities=tuple(_json_pairs(found.get("capacities"), "drone", "capacity")),
                feedback=_feedback_of(found),
                comments=tuple(_json_comments(found.get("comments"))),
            )
    _refuse_broken_json(plain, "a tracking assignment")
    said = sentences.split(plain)
    rows = sentences.assignment(said.body)
    if rows is None and _NOBODY.search(said.body):
        rows = ()
    if rows is None:
        raise AnswerError(_empty_words(plain, "a tracking assignment"))
    return TaskAnswer(
        assignment=rows,
        feedback=said.feedback[:LONGEST_FEEDBACK],
        comments=tuple(_line_comments(said.comments)),
    )


def read_action(text: str) -> ActionAnswer:
    """Read an action answer.

    Raises:
        AnswerError: when it holds no weights.
    """
    plain = without_thoughts(text)
    for found in json_objects(plain):
        weights = _json_weights(found)
        if weights is not None:
            severities = _json_zone_pairs(found.get("severities"))
            return ActionAnswer(
                weights=weights,
                severities=tuple(severities),
                replan=tuple(_id(value) for value in _sequence(found.get("replan"))),
                feedback=_feedback_of(found),
                comments=tuple(_json_comments(found.get("comments"))),
            )
    _refuse_broken_json(plain, "weights")
    said = sentences.split(plain)
    numbers = sentences.weights(said.body)
    if numbers is None:
        raise AnswerError(_empty_words(plain, "a list of 4 weights"))
    return ActionAnswer(
        weights=numbers,
        severities=sentences.severities(said.body),
        replan=sentences.replans(said.body),
        feedback=said.feedback[:LONGEST_FEEDBACK],
        comments=tuple(_line_comments(said.comments)),
    )


def is_whole(text: str) -> bool:
    """Return whether an answer that ended at the token limit had said everything that counts."""
    plain = without_thoughts(text)
    return bool(next(json_objects(plain), None)) or bool(sentences.split(plain).feedback)


def is_refusal(text: str) -> bool:
    """Return whether a model declines to answer at all."""
    return bool(_REFUSAL.search(text[:400]))


def _refuse_broken_json(text: str, wanted: str) -> None:
    """Keep pieces of a JSON object from being read as if they were plain lines."""
    if _MEANT_AS_JSON.search(text):
        raise AnswerError(f"The JSON is broken, cut off, or holds no {wanted.removeprefix('a ')}.")


def _empty_words(text: str, wanted: str) -> str:
    if not text.strip():
        return f"The answer was empty; {wanted} was asked for."
    if is_refusal(text):
        return f"The answer was a refusal; {wanted} was asked for."
    return f"The answer holds no {wanted.removeprefix('a ')}; keep to the format asked for."


# ---------------------------------------------------------------------------- JSON


def _json_rows(found: Pairs) -> Rows | None:
    """Return the rows of an object that is, or holds, an assignment."""
    assignment = found.get("assignment", found.get("assignments"))
    if isinstance(assignment, Pairs):
        rows = [(_id(key), _row(value)) for key, value in assignment.items]
    elif isinstance(assignment, Sequence) and not isinstance(assignment, str):
        rows = list(_row_objects(assignment))
    elif "assignment" not in found.keys and all(
        isinstance(value, list) and _id(key) != _NOT_AN_ID for key, value in found.items
    ):
        rows = [(_id(key), _row(value)) for key, value in found.items]
    else:
        return None
    # An assignment said to be empty is one: with no drone left it is right.
    return tuple(rows) if rows or assignment is not None else None


def _row_objects(items: Sequence[Any]) -> Iterator[tuple[int, tuple[int, ...]]]:
    """Read rows written as objects: {"drone": 21, "targets": [122]}."""
    for item in items:
        if isinstance(item, Pairs):
            robot = next((v for k, v in item.items if k in ("drone", "robot", "id")), None)
            row = next((v for k, v in item.items if k in ("targets", "target", "tracks")), ())
            yield _id(robot), _row(row)


def _row(value: object) -> tuple[int, ...]:
    if value is None or (isinstance(value, str) and not re.search(r"\d", value)):
        return ()
    return tuple(_id(item) for item in _sequence(value))


def _sequence(value: object) -> Sequence[Any]:
    if value is None:
        return ()
    return value if isinstance(value, list) else [value]


def _id(value: object) -> int:
    """Read an id said as 21, 21.0, "21" or "Drone 21"."""
    if isinstance(value, bool):
        return _NOT_AN_ID
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        return int(value) if value.is_integer() else _NOT_AN_ID
    match = re.fullmatch(r"\D{0,20}?(\d{1,9})", value.strip()) if isinstance(value, str) else None
    return int(match.group(1)) if match else _NOT_AN_ID


def _number(value: object) -> float:
    """Read a number; what is none becomes NaN, which is refused."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return math.nan
    try:
        return float(value)
    except (ValueError, OverflowError):
        return math.nan


def _json_weights(found: Pairs) -> tuple[float, ...] | None:
    weights = found.get("weights", found.get("weight"))
    if weights is None and set(_WEIGHT_KEYS) <= set(found.keys):
        weights = found
    if isinstance(weights, Pairs):
        keys = [str(key).lower() for key in weights.keys]
        order = _WEIGHT_KEYS if set(keys) & set(_WEIGHT_KEYS) else ("w1", "w2", "w3", "w4")
        values = {str(key).lower(): value for key, value in weights.items}
        return tuple(_number(values[key]) for key in order if key in values)
    if isinstance(weights, list):
        nested = len(weights) == 1 and isinstance(weights[0], list)
        return tuple(_number(value) for value in (weights[0] if nested else weights))
    return None


def _json_pairs(value: object, key: str, number: str) -> Iterator[tuple[int, int]]:
    """Read [{"drone": 21, "capacity": 1}] or {"21": 1}."""
    if isinstance(value, Pairs):
        yield from ((_id(name), _id(amount)) for name, amount in value.items)
        return
    for item in _sequence(value):
        if isinstance(item, Pairs):
            yield _id(item.get(key)), _id(item.get(number))


def _json_zone_pairs(value: object) -> Iterator[tuple[str, float]]:
    if isinstance(value, Pairs):
        yield from ((str(name), _number(amount)) for name, amount in value.items)
        return
    for item in _sequence(value):
        if isinstance(item, Pairs):
            yield str(item.get("zone", "")), _number(item.get("severity"))


def _feedback_of(found: Pairs) -> str:
    feedback = found.get("feedback", "")
    return _to_people(feedback) if isinstance(feedback, str) else ""


def _to_people(said: str) -> str:
    return words.writable(said.strip()[:LONGEST_FEEDBACK])


def _json_comments(value: object) -> Iterator[SaidOfComment]:
    for item in _sequence(value):
        if isinstance(item, Pairs):
            said: Mapping[str, object] = {str(key): v for key, v in item.items}
            verdict = _verdict(str(said.get("verdict", "")))
            if verdict is not None:
                reason = _to_people(str(said.get("reason", "")))
                yield SaidOfComment(str(said.get("id", "")), verdict, reason)


def _line_comments(lines: Sequence[tuple[str, str, str]]) -> Iterator[SaidOfComment]:
    for label, said, reason in lines:
        verdict = _verdict(said)
        if verdict is not None:
            yield SaidOfComment(label, verdict, reason[:LONGEST_FEEDBACK])


def _verdict(said: str) -> CommentVerdict | None:
    normal = said.strip().lower().replace(" ", "_")
    by_word = {"partly": CommentVerdict.PARTLY, "partially_applied": CommentVerdict.PARTLY}
    if normal in by_word:
        return by_word[normal]
    return CommentVerdict(normal) if normal in set(CommentVerdict) else None
