"""What is wrong with a scenario, in words: file, field, allowed range.

The ranges are not written twice: they are read from the JSON schema of the very model that
refused the value.
"""

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel, ValidationError

from server.errors import BadInput

_RANGE_ERRORS = frozenset(
    {"greater_than", "greater_than_equal", "less_than", "less_than_equal", "enum", "literal_error"}
)
_WORDS = {
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "union_tag_invalid": "is of no known kind",
    "union_tag_not_found": "needs a kind",
}

Location = tuple[int | str, ...]
JsonSchema = Mapping[str, Any]

MAX_PROBLEMS = 20
"""A file with more is told of these, and how many there are besides."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong, and where."""

    path: str
    """Such as robots[0].position[1]; empty for the file as a whole."""

    text: str

    def __str__(self) -> str:
        return f"{self.path}: {self.text}" if self.path else self.text


class ScenarioError(BadInput):
    """Raised when a scenario cannot be read, or breaks its own rules.

    One line per problem, each naming the file, the field and what is allowed.
    """

    def __init__(self, origin: str, problems: Iterable[Problem]) -> None:
        self.origin = origin
        self.problems = tuple(problems)
        shown = [f"{origin}: {problem}" for problem in self.problems[:MAX_PROBLEMS]]
        if (hidden := len(self.problems) - MAX_PROBLEMS) > 0:
            shown.append(f"{origin}: and {hidden} more problems")
        super().__init__("\n".join(shown))


class InconsistentError(ValueError):
    """Raised by a model whose fields are fine one by one, but do not fit together."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("; ".join(map(str, self.problems)))


def closest(word: str, known: Iterable[str]) -> str:
    """Return `, did you mean "..."?` for the likeliest known word, or nothing."""
    matches = difflib.get_close_matches(word, list(known), n=1)
    return f', did you mean "{matches[0]}"?' if matches else ""


def problems_of(error: ValidationError, model: type[BaseModel]) -> tuple[Problem, ...]:
    """Return what pydantic found, in our words, in the order it was found."""
    walk = _SchemaWalk(model.model_json_schema())
    found: list[Problem] = []
    for entry in error.errors(include_url=False):
        cause = entry.get("ctx", {}).get("error")
        path, node = walk.find(entry["loc"])
        if isinstance(cause, InconsistentError):
            found += [Problem(_joined(path, p.path), p.text) for p in cause.problems]
        else:
            found.append(Problem(path, _text(entry["type"], entry["msg"], entry["input"], node)))
    return tuple(found)


def _text(kind: str, message: str, value: object, node: "_Node") -> str:
    if kind == "missing":
        return f"is missing{_hint(node.allowed)}"
    if kind == "extra_forbidden":
        return f"unknown key{closest(node.name, node.siblings)}"
    if kind == "value_error":
        return message.removeprefix("Value error, ")
    if kind in _RANGE_ERRORS and node.allowed:
        return f"must be {node.allowed}, got {_shown(value)}"
    words = _WORDS.get(kind) or message.replace("Input should be", "must be").rstrip(".")
    return f"{words}{_hint(node.allowed)}, got {_shown(value)}"


def _hint(allowed: str) -> str:
    return f" (allowed: {allowed})" if allowed else ""


def _shown(value: object) -> str:
    if isinstance(value, Mapping):
        return "a mapping"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _joined(path: str, inner: str) -> str:
    separator = "." if path and inner and not inner.startswith("[") else ""
    return f"{path}{separator}{inner}"


@dataclass(frozen=True, slots=True)
class _Node:
    """A place in a document: its last key, the keys beside it, and what may stand there."""

    name: str
    siblings: tuple[str, ...] = ()
    allowed: str = ""


@dataclass(slots=True)
class _SchemaWalk:
    """Follows pydantic's locations through the JSON schema of a model."""

    root: JsonSchema
    _step_rules: tuple[Callable[[JsonSchema, int | str], JsonSchema | None], ...] = field(
        init=False
    )

    def __post_init__(self) -> None:
        self._step_rules = (_property, _item, _entry)

    def find(self, location: Location) -> tuple[str, _Node]:
        """Return the readable path of a location and what is known about it."""
        path = ""
        here = self._alternatives(self.root)
        siblings: tuple[str, ...] = ()
        for step in location:
            if step == "[key]" or self._is_tag(here, step):
                here = self._tagged(here, step)
                continue
            siblings = tuple(key for node in here for key in node.get("properties", {}))
            path = _joined(path, f"[{step}]" if isinstance(step, int) else step)
            here = [
                option
                for node in here
                for rule in self._step_rules
                if (reached := rule(node, step)) is not None
                for option in self._alternatives(reached)
            ]
        name = str(location[-1]) if location else ""
        return path, _Node(name, siblings, " or ".join(filter(None, map(_allowed, here))))

    def _alternatives(self, node: JsonSchema) -> list[JsonSchema]:
        if "$ref" in node:
            name = str(node["$ref"]).rsplit("/", 1)[-1]
            return self._alternatives(self.root["$defs"][name])
        options = node.get("anyOf") or ([] if "discriminator" in node else node.get("oneOf"))
        if options:
            return [found for option in options for found in self._alternatives(option)]
        return [node]

    @staticmethod
    def _is_tag(nodes: list[JsonSchema], step: int | str) -> bool:
        return any(step in node.get("discriminator", {}).get("mapping", {}) for node in nodes)

    def _tagged(self, nodes: list[JsonSchema], step: int | str) -> list[JsonSchema]:
        return [
            found
            for node in nodes
            if (ref := node.get("discriminator", {}).get("mapping", {}).get(step)) is not None
            for found in self._alternatives({"$ref": ref})
        ]


def _property(node: JsonSchema, step: int | str) -> JsonSchema | None:
    found: JsonSchema | None = node.get("properties", {}).get(step)
    return found


def _item(node: JsonSchema, step: int | str) -> JsonSchema | None:
    if not isinstance(step, int):
        return None
    prefix = node.get("prefixItems", [])
    found: JsonSchema | None = prefix[step] if step < len(prefix) else node.get("items")
    return found


def _entry(node: JsonSchema, step: int | str) -> JsonSchema | None:
    if step in node.get("properties", {}):
        return None
    found = node.get("additionalProperties")
    return found if isinstance(found, Mapping) else None


def _allowed(node: JsonSchema) -> str:
    """Return a schema's own bounds in words, empty where it has none."""
    if "discriminator" in node:
        return _one_of(node["discriminator"]["mapping"])
    if "const" in node:
        return str(node["const"])
    if "enum" in node:
        return _one_of(node["enum"])
    if node.get("type") == "array":
        return _count_range(node.get("minItems"), node.get("maxItems"))
    lower = [f"at least {node['minimum']:g}"] if "minimum" in node else []
    lower += [f"above {node['exclusiveMinimum']:g}"] if "exclusiveMinimum" in node else []
    upper = [f"at most {node['maximum']:g}"] if "maximum" in node else []
    upper += [f"below {node['exclusiveMaximum']:g}"] if "exclusiveMaximum" in node else []
    return " and ".join(lower + upper)


def _one_of(words: Iterable[object]) -> str:
    *first, last = map(str, words)
    return f"{', '.join(first)} or {last}" if first else last


def _count_range(fewest: int | None, most: int | None) -> str:
    if fewest is not None and fewest == most:
        return f"exactly {fewest} entries"
    parts = [f"{fewest} or more" if fewest else "", f"{most} or fewer" if most is not None else ""]
    words = " and ".join(filter(None, parts))
    return f"{words} entries" if words else ""
