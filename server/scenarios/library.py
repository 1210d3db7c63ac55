"""Finding scenarios: by name among those that come with Falconer, by path, or inline."""

import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from server.scenarios import authors
from server.scenarios.errors import Problem, ScenarioError, closest, problems_of
from server.scenarios.reading import parse, read
from server.scenarios.schema import Scenario

_SUFFIXES = (".yaml", ".yml")


def names() -> tuple[str, ...]:
    """Return the names of the scenarios that come with Falconer, sorted."""
    files = (entry.name for entry in resources.files("scenarios").iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml")))


def load(name_or_path: str) -> Scenario:
    """Return a scenario by its name or from a file: ours, or the paper authors'.

    A word of a path (a separator, or .yaml at its end) is a path, everything else a name.
    For the command line; a request over the network names (`named`) or brings (`inline`) its
    scenario and never reads a file.

    Raises:
        ScenarioError: No such scenario, or one that breaks the rules.
    """
    path = Path(name_or_path)
    if path.suffix.lower() in _SUFFIXES or len(path.parts) > 1 or path.is_absolute():
        return _scenario(read(path), origin=str(path), name=path.stem)
    return named(name_or_path)


def named(name: str) -> Scenario:
    """Return one of the scenarios that come with Falconer.

    Raises:
        ScenarioError: There is none of that name.
    """
    known = names()
    if name not in known:
        hint = closest(name, known) or f" (there are: {', '.join(known)})"
        raise ScenarioError(name[:80], [Problem("", f"there is no scenario of that name{hint}")])
    file = resources.files("scenarios") / f"{name}.yaml"
    origin = f"{name}.yaml"
    return _scenario(parse(file.read_text("utf-8"), origin), origin, name)


def inline(data: Mapping[str, Any]) -> Scenario:
    """Return a scenario that was brought along as plain data.

    Raises:
        ScenarioError: It breaks the rules.
    """
    return _scenario(data, origin="scenario", name="inline")


def _scenario(data: Mapping[str, Any], origin: str, name: str) -> Scenario:
    if authors.is_authors(data):
        safe_name = re.sub(r"[^A-Za-z0-9_.-]", "-", name)[:64] or "authors"
        return authors.convert(data, origin, safe_name)
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise ScenarioError(origin, problems_of(error, Scenario)) from error
