"""Whole missions in virtual time: the contract's keys, repeatable, steered by comments."""

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from llm.chat import ChatReply, ChatRequest, ErrorKind, LanguageModel, ModelError
from llm.mock.app import in_process_client
from server.lockstep.advice import VirtualAdvice
from server.lockstep.council import Council
from server.lockstep.driver import LOCKSTEP_BUDGET, Lockstep
from server.lockstep.exact import ExactAdvice
from server.lockstep.job import PAPER_LATENCY, Latency, ScriptedComment
from server.mission.core import MissionCore
from server.mission.setup import MissionSetup
from server.mission.tape import Committed, Difference, MemoryTape, TapedCore, replay
from server.models import Manner, manner_of
from server.scenarios.library import named
from solver import engines
from solver.directives import Pairing
from solver.planner import Planner
from solver.problem import Budget, Problem, Rung, Solution
from solver.streams import Streams
from vehicles.world.world import World

LOOP_KEYS = {
    "calls",
    "tries",
    "valid_first",
    "valid",
    "adopted",
    "success_rate",
    "mean_tokens_in",
    "mean_tokens_out",
    "mean_latency_s",
}
FOCUS = ScriptedComment(30.0, "The drone 0 should focus on tracking target 1")


HASTY, PATIENT = Manner(), manner_of("local")


@pytest.fixture(scope="module")
def planner() -> Planner:
    return Planner(engines.create(engines.default_engine()))


def fly(
    planner: Planner,
    model: LanguageModel | None,
    *comments: ScriptedComment,
    steps: int = 100,
    latency: Latency = PAPER_LATENCY,
    tape: MemoryTape | None = None,
    manner: Manner = HASTY,
) -> tuple[dict[str, Any], Lockstep]:
    scenario = named("ablation")
    setup = replace(scenario.mission_setup(), steps=steps)
    core = TapedCore(MissionCore(setup), tape or MemoryTape())
    council = Council(core, setup.gate, planner)
    advice = None if model is None else VirtualAdvice(council, model, latency, manner)
    run = Lockstep(
        setup, World(scenario.world_setup(), Streams(0)), council, planner, advice, comments
    )
    return asyncio.run(run.run(lambda _: None)), run


def untimed(result: dict[str, Any]) -> dict[str, Any]:
    optimizer = {k: v for k, v in result["optimizer"].items() if not k.endswith("_ms")}
    gate = {k: v for k, v in result["gate"].items() if not k.endswith("_ms")}
    return {**result, "wall_s": None, "optimizer": optimizer, "gate": gate}


def test_a_run_without_models_reports_every_key_of_the_contract(planner: Planner) -> None:
    result, _ = fly(planner, None, steps=20)
    assert result["steps"] == result["optimizer"]["ticks"] == 20
    assert result["dt"] == 0.5
    assert (result["robots"], result["targets"]) == (2, 4)
    assert result["accumulated_trace"] > 0.0
    assert 0.0 < result["trajectory_length_m"] < 20 * 0.5 * 0.75
    assert result["min_separation_m"] > 0.0
    assert 0.0 < result["position_error_m"] < 1.0
    assert result["optimizer"]["rungs"]["converged"] == 20
    assert set(result["task_llm"]) == set(result["action_llm"]) == LOOP_KEYS
    assert result["task_llm"]["success_rate"] is None
    assert "accumulated_trace_authors" in result


def test_the_same_seed_and_answers_give_the_same_run(planner: Planner) -> None:
    first, _ = fly(planner, in_process_client(), FOCUS, steps=80)
    again, _ = fly(planner, in_process_client(), FOCUS, steps=80)
    assert untimed(first) == untimed(again)


def test_a_comment_swaps_the_assignment_and_still_holds_at_the_next_calls(planner: Planner) -> None:
    result, run = fly(planner, in_process_client(), FOCUS, steps=130)
    (comment,) = result["comments"]
    assert comment["status"] == "applied"
    assert comment["task"]["verdict"] == "applied"
    assert result["directives"]["beta"] == 0
    assert 1 in result["directives"]["assignment"]["0"]
    assert Pairing(0, 1) in run.snapshot.directives.assignment
    assert result["task_llm"]["calls"] > 5


def test_an_answer_arrives_after_its_latency_and_not_before(planner: Planner) -> None:
    _, early = fly(planner, in_process_client(), FOCUS, steps=61, latency=Latency(0.0, 0.0))
    _, late = fly(planner, in_process_client(), FOCUS, steps=63, latency=Latency(1.36, 0.89))
    assert Pairing(0, 1) not in early.snapshot.directives.assignment
    assert Pairing(0, 1) not in late.snapshot.directives.assignment
    _, early = fly(planner, in_process_client(), FOCUS, steps=62, latency=Latency(0.0, 0.0))
    _, late = fly(planner, in_process_client(), FOCUS, steps=64, latency=Latency(1.36, 0.89))
    assert Pairing(0, 1) in early.snapshot.directives.assignment
    assert Pairing(0, 1) in late.snapshot.directives.assignment


def test_the_assignment_solver_advises_without_a_model(planner: Planner) -> None:
    scenario = named("ablation")
    setup = replace(scenario.mission_setup(), steps=200)
    core = TapedCore(MissionCore(setup), MemoryTape())
    world = World(scenario.world_setup(), Streams(0))
    council = Council(core, setup.gate, planner)
    run = Lockstep(setup, world, council, planner, ExactAdvice(council))
    result = asyncio.run(run.run(lambda _: None))
    alone, _ = fly(planner, None, steps=200)
    assert result["directives"]["assignment_source"] == "exact"
    assert result["directives"]["beta"] == 0
    assert result["accumulated_trace"] < alone["accumulated_trace"]
    assert result["task_llm"]["calls"] == 0


def test_a_model_on_this_machine_may_take_longer(planner: Planner) -> None:
    slow = Latency(20.0, 20.0)
    hosted, _ = fly(planner, in_process_client(), steps=60, latency=slow)
    local, _ = fly(planner, in_process_client(), steps=60, latency=slow, manner=PATIENT)
    assert (hosted["action_llm"]["valid"], local["action_llm"]["valid"]) == (0, 1)
    assert hosted["action_llm"]["mean_latency_s"] == pytest.approx(8.0)
    assert local["action_llm"]["mean_latency_s"] == pytest.approx(20.0)
    assert local["action_llm"]["mean_tokens_in"] < 900, "it is asked briefly"


class Unreachable:
    """A model that never answers."""

    def __init__(self, kind: ErrorKind) -> None:
        self.kind = kind

    async def complete(self, request: ChatRequest, timeout_s: float) -> ChatReply:
        raise ModelError(self.kind, "no answer")


class Babbling:
    """A model whose answers are never valid."""

    async def complete(self, request: ChatRequest, timeout_s: float) -> ChatReply:
        text = "Drone 0 should track Target 0. Drone 7 should track Target 1.\n[NaN, 1, 2]"
        return ChatReply(text=text, tokens_in=10, tokens_out=5, latency_s=0.1)


@pytest.mark.parametrize("kind", [ErrorKind.TIMEOUT, ErrorKind.CONNECTION, ErrorKind.SERVER])
def test_a_dead_model_changes_nothing_about_the_flight(planner: Planner, kind: ErrorKind) -> None:
    alone, _ = fly(planner, None, steps=60)
    dead, _ = fly(planner, Unreachable(kind), steps=60)
    for key in ("accumulated_trace", "sensing_attacks", "trajectory_length_m"):
        assert dead[key] == alone[key]
    assert dead["task_llm"]["calls"] > 0
    assert dead["task_llm"]["valid"] == 0


def test_a_babbling_model_is_retried_and_refused_whole(planner: Planner) -> None:
    alone, _ = fly(planner, None, steps=60)
    result, _ = fly(planner, Babbling(), steps=60)
    assert result["accumulated_trace"] == alone["accumulated_trace"]
    task = result["task_llm"]
    assert task["tries"] == 3 * task["calls"] > 0
    assert task["adopted"] == 0
    assert task["success_rate"] == 0.0
    assert task["mean_latency_s"] == pytest.approx(3 * 1.36)


def resolve(planner: Planner) -> Any:
    def solve(problem: Problem, recorded: Committed) -> Solution:
        return planner.solve(problem, LOCKSTEP_BUDGET)

    return solve


def test_a_taped_mission_replays_bit_for_bit(planner: Planner) -> None:
    tape = MemoryTape()
    _, run = fly(planner, in_process_client(), FOCUS, steps=80, tape=tape)
    differences = list(replay(_setup(80), tape.entries, resolve(planner)))
    assert differences == [None] * 80
    assert run.snapshot.tick == 79


def test_a_tape_cut_off_replays_to_its_last_whole_tick(planner: Planner) -> None:
    tape = MemoryTape()
    fly(planner, None, steps=10, tape=tape)
    cut = tape.entries[: len(tape.entries) // 2]
    whole = sum(isinstance(entry, Committed) for entry in cut)
    assert list(replay(_setup(10), cut, resolve(planner))) == [None] * whole


def test_a_tampered_tape_is_noticed(planner: Planner) -> None:
    tape = MemoryTape()
    fly(planner, None, steps=5, tape=tape)
    index = max(i for i, entry in enumerate(tape.entries) if isinstance(entry, Committed))
    last = tape.entries[index]
    assert isinstance(last, Committed)
    setpoint = last.setpoints[0]
    forged = replace(setpoint, velocity=(setpoint.velocity[0] + 1e-12, setpoint.velocity[1]))
    tape.entries[index] = replace(last, setpoints=(forged, *last.setpoints[1:]))
    found = list(replay(_setup(5), tape.entries, resolve(planner)))
    assert found[:-1] == [None] * 4
    assert isinstance(found[-1], Difference)


class Failing:
    """An engine that has no answer at any time."""

    name = "failing"

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        raise RuntimeError("broken")


def test_a_broken_engine_brakes_the_team_and_the_run_goes_on() -> None:
    result, _ = fly(Planner(Failing()), None, steps=10)
    assert result["optimizer"]["success_rate"] == 0.0
    assert result["optimizer"]["rungs"][Rung.BRAKE.value] > 0
    assert result["trajectory_length_m"] == 0.0


def _setup(steps: int) -> MissionSetup:
    return replace(named("ablation").mission_setup(), steps=steps)
