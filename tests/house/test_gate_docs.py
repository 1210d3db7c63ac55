"""The page on decision cards names every field of a decision card, and nothing else."""

import re
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Any

import pytest

from server.gate.decisions import (
    Approval,
    Changes,
    Decision,
    Effect,
    Fact,
    FactKind,
    GateVerdict,
    Judgement,
    Loop,
    Refuser,
    Status,
)
from server.gate.encoding import decision_object, merit_object
from server.gate.merit import Merit
from server.mission.setup import GateMode
from solver.directives import Source, Verdict
from tests.house.documents import CODE, first_cells

MERIT = Merit(5.0, 1.0, 0.1, 0.0, 2.0)
WHOLE = ("changes.", "facts[].", "verification.", "gate.", "approval.", "effect.")
"""Objects that are documented field by field; others as one."""


@pytest.fixture
def section(root: Path) -> str:
    return (root / "docs" / "reference" / "cards.md").read_text("utf-8")


def _card() -> dict[str, Any]:
    card = Decision(
        "d1",
        "a1",
        Loop.ACTION,
        Source.ACTION_LLM,
        "action model",
        1.0,
        2.0,
        Status.ADOPTED,
        changes=Changes(weights=(("tracking", 1.0, 2.0),)),
        facts=(Fact(FactKind.TRACE, "The trace is 1.", value=1.0),),
        verification=Verdict("a1"),
        gate=GateVerdict(GateMode.AUTO, Judgement.BETTER, "", 5.0, MERIT, MERIT, 0.0, 0.1),
        approval=Approval(1.0, 31.0),
        effect=Effect(2.0, 7.0, MERIT, 0.2, MERIT, 0.2),
    )
    return decision_object(card)


def _fields(value: Any, name: str = "") -> Iterator[str]:
    if isinstance(value, dict) and (not name or f"{name}." in WHOLE):
        for key, item in value.items():
            yield from _fields(item, f"{name}.{key}" if name else key)
    elif isinstance(value, list) and f"{name}[]." in WHOLE:
        for item in value:
            for key in item:
                yield f"{name}[].{key}"
    else:
        yield name


def test_every_field_of_a_card_is_documented_and_exists(section: str) -> None:
    documented = {code for cell in first_cells(section) for code in CODE.findall(cell)}
    assert documented == set(_fields(_card()))


def test_every_part_of_a_merit_is_documented(section: str) -> None:
    assert set(merit_object(MERIT)) <= set(CODE.findall(section))


@pytest.mark.parametrize("values", [Loop, Status, Refuser, Judgement, FactKind, GateMode])
def test_every_value_is_documented(section: str, values: type[StrEnum]) -> None:
    assert {value.value for value in values} <= set(re.findall(r"`(\w+)`", section))
