"""The page on scenario files names every field with its default, and nothing else."""

import json
import re
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Union, get_args, get_origin

import pytest
import yaml
from pydantic import BaseModel, TypeAdapter

from server.scenarios.schema import Scenario
from tests.house.documents import FENCE

REQUIRED = "required"


def _models(annotation: Any) -> Iterator[tuple[str, type[BaseModel]]]:
    """Yield the models of a field with what stands between its name and theirs."""
    origin = get_origin(annotation)
    if origin is Annotated:
        yield from _models(get_args(annotation)[0])
    elif origin in {Union, types.UnionType}:
        for choice in get_args(annotation):
            yield from _models(choice)
    elif origin is tuple:
        for suffix, model in _models(get_args(annotation)[0]):
            yield f"[]{suffix}", model
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield "", annotation


def _fields(model: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield (dotted name, default as it is written in a file) of every plain field."""
    for name, field in model.model_fields.items():
        parts = list(_models(field.annotation))
        for suffix, part in parts:
            yield from _fields(part, f"{prefix}{name}{suffix}.")
        if not parts:
            shown = REQUIRED if field.is_required() else _written(field.default)
            yield f"{prefix}{name}", shown


def _written(default: Any) -> str:
    """Return a default as the page writes it; none at all where null or nothing stands for it."""
    plain = TypeAdapter(Any).dump_python(default, mode="json")
    if plain in (None, ""):
        return ""
    return plain if isinstance(plain, str) else json.dumps(plain)


@pytest.fixture
def page(root: Path) -> str:
    return (root / "docs" / "reference" / "scenarios.md").read_text("utf-8")


def test_every_field_is_documented_with_its_default(page: str) -> None:
    rows = re.findall(r"^\| `([^`]+)` \| (?:`([^`]+)`|(\w*)) *\|", page, re.MULTILINE)
    documented = {(name, code or word) for name, code, word in rows}
    fields = set(_fields(Scenario))
    chosen = {(name, REQUIRED) for name, shown in fields if name.endswith("motion.kind")}
    assert documented == fields - chosen


def test_the_example_is_a_scenario(page: str) -> None:
    examples = [text for language, text in FENCE.findall(page) if language == "yaml"]
    assert examples
    for example in examples:
        Scenario.model_validate(yaml.safe_load(example))
