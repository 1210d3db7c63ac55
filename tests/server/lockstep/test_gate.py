"""The gate in virtual time: the same every time, on the tape, and nobody there to confirm."""

import asyncio
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from benchmarks.gate import Careless
from server.lockstep.advice import VirtualAdvice
from server.lockstep.council import Council
from server.lockstep.driver import LOCKSTEP_BUDGET, Lockstep
from server.lockstep.job import PAPER_LATENCY
from server.mission.core import MissionCore
from server.mission.setup import GateMode, MissionSetup
from server.mission.tape import Entry, MemoryTape, Proposed, TapedCore, replay
from server.scenarios.library import named
from solver import engines
from solver.planner import Planner
from solver.streams import Streams
from vehicles.world.world import World

STEPS = 120


@pytest.fixture(scope="module")
def planner() -> Planner:
    return Planner(engines.create(engines.default_engine()))


def setup_of(mode: GateMode) -> MissionSetup:
    return replace(named("ablation").mission_setup(), steps=STEPS, gate=mode)


def fly(planner: Planner, mode: GateMode) -> tuple[dict[str, Any], list[Entry]]:
    """Fly with an adviser whose answers are valid and random."""
    setup, tape = setup_of(mode), MemoryTape()
    own = Planner(engines.create(engines.default_engine()))
    council = Council(TapedCore(MissionCore(setup), tape), mode, own)
    advice = VirtualAdvice(council, Careless(setup), PAPER_LATENCY)
    world = World(named("ablation").world_setup(), Streams(0))
    run = Lockstep(setup, world, council, planner, advice)
    return asyncio.run(run.run(lambda _: None)), tape.entries


def test_two_runs_under_the_gate_make_the_same_decisions(planner: Planner) -> None:
    (first, tape), (again, other) = (fly(planner, GateMode.AUTO) for _ in range(2))
    assert first["decisions"] == again["decisions"]
    assert first["accumulated_trace"] == again["accumulated_trace"]
    assert tape == other
    assert first["gate"]["refused"]["gate"] > 0
    assert first["gate"]["gone_into_force"] > 0


def test_a_gated_mission_replays_bit_for_bit_without_a_gate(planner: Planner) -> None:
    _, tape = fly(planner, GateMode.AUTO)
    assert any(isinstance(entry, Proposed) and entry.refusal for entry in tape)
    again = replay(
        setup_of(GateMode.AUTO), tape, lambda problem, _: planner.solve(problem, LOCKSTEP_BUDGET)
    )
    assert list(again) == [None] * STEPS


def test_a_shadow_predicts_and_changes_nothing(planner: Planner) -> None:
    off, _ = fly(planner, GateMode.OFF)
    shadow, _ = fly(planner, GateMode.SHADOW)
    assert off["accumulated_trace"] == shadow["accumulated_trace"]
    assert off["gate"]["forecasts"] == 0
    assert shadow["gate"]["forecasts"] == shadow["gate"]["changing"] > 0
    judgements = {card["gate"]["judgement"] for card in shadow["decisions"]}
    assert "clearly_worse" in judgements


def test_where_nobody_confirms_every_change_is_refused_by_its_time_out(planner: Planner) -> None:
    result, _ = fly(planner, GateMode.CONFIRM)
    start = setup_of(GateMode.CONFIRM)
    assert result["directives"]["weights"] == start.weights._asdict()
    assert result["gate"]["gone_into_force"] == 0
    decided = [c for c in result["decisions"] if c["changed"] and c["status"] == "refused"]
    assert decided
    assert {card["refused_by"] for card in decided} == {"timeout"}
    for card in decided:
        waited_s = card["decided_s"] - card["approval"]["asked_s"]
        assert waited_s == pytest.approx(start.merit.approval_s)
    # A model is not asked again while its last answer waits.
    action = [card["time_s"] for card in result["decisions"] if card["loop"] == "action"]
    assert min(b - a for a, b in pairwise(action)) > start.merit.approval_s
