"""Finding what counts in a model's text: thoughts cut away, JSON objects picked out."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

MOST_OBJECTS = 64
"""Candidates tried before a text counts as holding no JSON."""

LONGEST_TEXT = 65_536
MOST_DIGITS = 18
"""Of a whole number; one with more is read as a float, infinite at worst."""

_THOUGHT = re.compile(r"<(/?)(?:think|thinking|reasoning)>", re.I)


@dataclass(frozen=True, slots=True)
class Pairs:
    """A JSON object as it was written: repeated keys are kept, in order."""

    items: tuple[tuple[str, Any], ...]

    @property
    def keys(self) -> tuple[str, ...]:
        """Return the keys, repeated ones too."""
        return tuple(key for key, _ in self.items)

    def get(self, key: str, default: Any = None) -> Any:
        """Return the first value of a key."""
        return next((value for name, value in self.items if name == key), default)


def without_thoughts(text: str) -> str:
    """Return a text without its think-blocks; of an unclosed one nothing is kept."""
    text = text[:LONGEST_TEXT]
    kept: list[str] = []
    depth, start = 0, 0
    for match in _THOUGHT.finditer(text):
        if match[1] == "":
            if depth == 0:
                kept.append(text[start : match.start()])
            depth += 1
        elif depth == 0:
            # The block was opened before the text began: everything so far was thought.
            kept.clear()
        else:
            depth -= 1
        start = match.end()
    if depth == 0:
        kept.append(text[start:])
    return " ".join(kept)


def json_objects(text: str) -> Iterator[Pairs]:
    """Yield the outermost JSON objects of a text, the last first: models end with the answer.

    NaN and Infinity are read as such. What is no JSON is passed over, with everything in it:
    the inner objects of a broken or cut-off answer are no answer.
    """
    decoder = json.JSONDecoder(
        object_pairs_hook=lambda pairs: Pairs(tuple(pairs)), parse_int=_whole_number
    )
    found: list[Pairs] = []
    position, tried = text.find("{"), 0
    while position >= 0 and tried < MOST_OBJECTS:
        tried += 1
        try:
            value, end = decoder.raw_decode(text, position)
        except json.JSONDecodeError as error:
            position = text.find("{", max(error.pos, position + 1))
            continue
        except RecursionError:
            return
        if isinstance(value, Pairs):
            found.append(value)
        position = text.find("{", end)
    yield from reversed(found)


def _whole_number(digits: str) -> int | float:
    """Read a whole number; a model that repeats one digit for ever must not be an error of ours."""
    return int(digits) if len(digits) <= MOST_DIGITS else float(digits)
