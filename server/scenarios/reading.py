"""Reading YAML that a stranger may have written.

Core schema of YAML 1.2 (so that `off` is a word and `1e-3` a number), no repeated keys, no
aliases (they make small files huge), bounded size, nothing but plain data.
"""

import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any, cast

import yaml

from server.scenarios.errors import Problem, ScenarioError

MAX_BYTES = 1024 * 1024

_FLOAT = (
    r"^(?:[-+]?(?:\.[0-9]+|[0-9]+\.[0-9]*|[0-9]+(?=[eE]))(?:[eE][-+]?[0-9]+)?"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
)
_RESOLVERS = (
    ("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", list("tTfF")),
    ("null", r"^(?:~|null|Null|NULL|)$", ["~", "n", "N", ""]),
    ("int", r"^[-+]?(?:0|[1-9][0-9]{0,17})$", list("-+0123456789")),
    ("float", _FLOAT, list("-+.0123456789")),
)
"""Kind, what it looks like, and its possible first characters."""


class _Loader(yaml.SafeLoader):
    """Plain data only, under the rules above."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - as the base class declares it

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Refuse aliases before anything is made of them."""
        if self.check_event(yaml.AliasEvent):
            mark = cast(Any, self).get_event().start_mark  # the stubs leave it untyped
            raise yaml.composer.ComposerError(None, None, "aliases are not allowed", mark)
        return super().compose_node(parent, index)

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Refuse keys that appear twice: one of them would be lost in silence."""
        found = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                problem = "a key must be a plain word or number"
            elif key in found:
                problem = f'the key "{key}" appears twice'
            else:
                found.add(key)
                continue
            raise yaml.constructor.ConstructorError(None, None, problem, key_node.start_mark)


for _kind, _pattern, _first in _RESOLVERS:
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_kind}", re.compile(_pattern), _first)


def parse(text: str, origin: str) -> dict[str, Any]:
    """Return the mapping a YAML text holds.

    Raises:
        ScenarioError: The text is no YAML (with the line), or no mapping of words.
    """
    try:
        data = yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        raise ScenarioError(origin, [Problem(_place(error), _reason(error))]) from error
    except yaml.YAMLError as error:  # unreadable characters: no mark, but a position
        raise ScenarioError(origin, [Problem("", f"is not YAML: {error}")]) from error
    except RecursionError as error:
        raise ScenarioError(origin, [Problem("", "is nested too deeply")]) from error
    if not isinstance(data, dict):
        raise ScenarioError(origin, [Problem("", "must be a mapping of keys to values")])
    return data


def read(path: Path) -> dict[str, Any]:
    """Return the mapping a YAML file holds, UTF-8, at most 1 MiB.

    Raises:
        ScenarioError: The file cannot be read, is too large, or holds no mapping.
    """
    origin = str(path)
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise ScenarioError(origin, [Problem("", f"cannot be read: {reason}")]) from error
    if len(raw) > MAX_BYTES:
        raise ScenarioError(origin, [Problem("", "is larger than the 1 MiB allowed")])
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScenarioError(origin, [Problem("", "is not UTF-8 text")]) from error
    return parse(text, origin)


def _place(error: yaml.MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    return f"line {mark.line + 1}, column {mark.column + 1}" if mark else ""


def _reason(error: yaml.MarkedYAMLError) -> str:
    parts = [part for part in (error.context, error.problem) if part]
    return f"is not valid here: {', '.join(parts)}" if parts else "is not YAML"
