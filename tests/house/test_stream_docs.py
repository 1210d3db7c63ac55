"""The page on the stream names every field of every message, and nothing else."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from server.encoding import (
    EventKind,
    MissionState,
    Severity,
    event_message,
    snapshot_message,
    truth_object,
)
from server.loops import LoopReport
from server.mission.setup import ZoneDefaults
from server.recording.playback import replay_object
from solver.arrays import frozen, frozen_bool
from solver.directives import CommentVerdict, Directives, Pairing, Pin, Source, Weights
from solver.observations import Comment, HoldState, Link
from solver.problem import Rung
from solver.snapshot import (
    CommentReceipt,
    Guidance,
    InferredZone,
    RobotTable,
    Snapshot,
    SolveSummary,
    TrackStatus,
    TrackTable,
)
from solver.zones import Zone, ZoneKind
from tests.house.documents import CODE, first_cells, sections

BY_ID = re.compile(
    r"^(directives\.(assignment|weights|weight_bounds|capacities|severities)|attacks|data)\."
)
"""Objects whose keys are data; the object is documented as one field."""

REPORT = LoopReport(calls=3, missed=0, rate_hz=10.0, mean_s=0.01, success_rate=1.0, age_s=0.1)
WEIGHTS = Weights(10.0, 0.05, 50.0, 50.0)


@pytest.fixture
def page(root: Path) -> str:
    return (root / "docs" / "reference" / "stream.md").read_text("utf-8")


def _snapshot() -> Snapshot:
    zone = Zone("s1", ZoneKind.SENSING, (1.0, 1.0), ((0.1, 0.0), (0.0, 0.1)), 0.1, 0.1)
    comment = Comment("c1", "Look after target 122.", 1.0, 120.0)
    return Snapshot(
        mission="m1",
        tick=7,
        time_s=0.7,
        robots=RobotTable(
            ids=(21,),
            positions=frozen([[0.0, 0.0]]),
            velocities=frozen([[0.0, 0.0]]),
            altitudes=frozen([1.5]),
            sensing_failed=frozen_bool([False]),
            links=(Link.CONNECTED,),
            state_age_s=frozen([0.05]),
            setpoint_velocities=frozen([[0.1, 0.0]]),
            waypoints=frozen([[0.1, 0.0]]),
        ),
        tracks=TrackTable(
            ids=(122,),
            positions=frozen([[2.0, 2.0]]),
            velocities=frozen([[0.0, 0.0]]),
            covariances=frozen([0.1 * np.eye(2)]),
            unseen_s=frozen([0.0]),
            status=(TrackStatus.TRACKED,),
        ),
        zones=(zone,),
        known=frozen_bool([[True]]),
        directives=Directives(
            assignment=frozenset({Pairing(21, 122)}),
            weights=WEIGHTS,
            capacities=((21, 1),),
            severities=(("s1", 2.0),),
            pins=(Pin("p1", Pairing(21, 122), 120.0, "c1"),),
            assignment_source=Source.TASK_LLM,
        ),
        hold=HoldState.FLYING,
        trace=0.2,
        solve=SolveSummary(Rung.CONVERGED, 1.0, 5, 0.001),
        attacks=(),
        receipts=(CommentReceipt(comment, CommentVerdict.APPLIED, "done", CommentVerdict.NOTED),),
        guidance=Guidance.MODEL,
        guidance_age_s=0.5,
        inferred=(InferredZone("s1", 0.7, zone.covariance, zone.covariance, 1.0, 0.2, 3.0),),
    )


def _message() -> dict[str, Any]:
    snapshot = _snapshot()
    return snapshot_message(
        snapshot,
        state=MissionState.RUNNING,
        loops={"optimizer": REPORT, "task_llm": REPORT, "action_llm": REPORT},
        field=((-10.0, -5.0), (10.0, 5.0)),
        weight_bounds=(WEIGHTS, WEIGHTS),
        severity_bounds=(1.0, 5.0),
        zone_defaults=dict.fromkeys(ZoneKind, ZoneDefaults(0.1, 0.1, 0.1)),
        attacks={ZoneKind.SENSING: 1},
        mission="m1",
        truth=truth_object({21: (0.0, 0.0)}, {122: (2.0, 2.0)}, snapshot.zones),
    ) | {"replay": replay_object(60.0, 1.0, "running")}


def _fields(value: Any, name: str = "") -> Iterator[str]:
    """Yield the dotted name of every field, `[]` for entries of a list, `*` for loops by name."""
    if isinstance(value, dict):
        for key, item in value.items():
            part = "*" if name == "loops" else key
            yield from _fields(item, f"{name}.{part}" if name else part)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for item in value:
            yield from _fields(item, f"{name}[]")
    else:
        yield name
    if name:
        yield name


def _is_own_field(name: str) -> bool:
    return not BY_ID.match(name) and not name.endswith("[]")


def _documented(section: str) -> set[str]:
    return {code for cell in first_cells(section) for code in CODE.findall(cell)}


def test_every_field_of_a_snapshot_is_documented_and_exists(page: str) -> None:
    fields = {name for name in _fields(_message()) if _is_own_field(name)}
    parents = {re.sub(r"(\[\])?\.[^.]+$", "", name) for name in fields if "." in name}
    documented = _documented(sections(page, 2)["`snapshot`"])
    assert fields - documented - parents == set()
    assert documented - fields == set()


def test_every_field_of_an_event_is_documented_and_exists(page: str) -> None:
    event = event_message("m1", 1, 0.1, EventKind.HOLD, Severity.INFO, "Held.")
    section = sections(page, 2)["`event`"].split("### Kinds")[0]
    assert _documented(section) == set(event)


def test_every_kind_of_event_is_documented_and_exists(page: str) -> None:
    assert _documented(sections(page, 3)["Kinds"]) == {kind.value for kind in EventKind}


@pytest.mark.parametrize("values", [MissionState, Severity, Link, TrackStatus, Source, Guidance])
def test_every_value_is_documented(page: str, values: Any) -> None:
    assert {value.value for value in values} - set(CODE.findall(page)) == set()
