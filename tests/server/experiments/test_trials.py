"""A key changes with whatever may change a figure, and with nothing else."""

from dataclasses import replace

import pytest

from server.experiments.missions import MissionTrial, PlannerChange, Policy
from server.experiments.trials import key_of
from server.lockstep.job import Latency, ScriptedComment
from server.mission.setup import GateMode
from server.scenarios import library
from solver.directives import Weights

SCENARIO = library.named("ablation").varied(steps=3)
POLICY = Policy("mock", "mock")
TRIAL = MissionTrial(POLICY, SCENARIO, 0, GateMode.OFF, "fast")


def _with(**changes: object) -> MissionTrial:
    return replace(TRIAL, policy=replace(POLICY, **changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "other",
    [
        replace(TRIAL, seed=1),
        replace(TRIAL, gate=GateMode.SHADOW),
        replace(TRIAL, engine="sqp"),
        replace(TRIAL, latency=Latency(1.0, 1.0)),
        replace(TRIAL, scenario=SCENARIO.varied(steps=4)),
        _with(llm="none"),
        _with(llm="http://127.0.0.1:9/v1"),
        _with(comments=(ScriptedComment(1.0, "Hello"),)),
        _with(weights=Weights(10.0, 0.05, 60.0, 50.0)),
        _with(planner=PlannerChange(horizon=1)),
        _with(planner=PlannerChange(priced=False)),
    ],
)
def test_a_key_changes_with_what_decides_the_figures(other: MissionTrial) -> None:
    assert key_of(other) != key_of(TRIAL)


def test_a_key_does_not_change_with_a_name_or_the_files_own_seed() -> None:
    assert key_of(_with(name="other")) == key_of(TRIAL)
    assert key_of(replace(TRIAL, scenario=SCENARIO.varied(seed=5))) == key_of(TRIAL)


def test_an_endpoints_model_is_part_of_the_key_and_its_secret_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    endpoint = _with(llm="http://127.0.0.1:9/v1")
    monkeypatch.setenv("FALCONER_LLM_MODEL", "one")
    monkeypatch.setenv("FALCONER_LLM_API_KEY", "secret-of-mine")
    first = key_of(endpoint)
    assert "secret-of-mine" not in str(endpoint.identity())
    monkeypatch.setenv("FALCONER_LLM_API_KEY", "another")
    assert key_of(endpoint) == first
    monkeypatch.setenv("FALCONER_LLM_MODEL", "two")
    assert key_of(endpoint) != first


def test_the_gate_and_the_planner_reach_the_mission() -> None:
    trial = replace(
        TRIAL,
        gate=GateMode.SHADOW,
        policy=replace(POLICY, planner=PlannerChange(horizon=1, priced=False)),
    )
    setup = trial.setup()
    assert (setup.gate, setup.planner.horizon, setup.planner.engine) == (
        GateMode.SHADOW,
        1,
        "fast",
    )
    assert (setup.planner.sensing_failure_s, setup.planner.communication_failure_s) == (0.0, 0.0)
    assert TRIAL.setup().planner.sensing_failure_s > 0.0


def test_weights_set_beforehand_are_in_force_to_the_end() -> None:
    weights = Weights(10.0, 0.05, 60.0, 55.0)
    trial = replace(TRIAL, policy=Policy("safer", "exact", weights=weights))
    result = trial.perform()
    assert result["directives"]["weights"] == weights._asdict()
    assert result["directives"]["weights_source"] == "operator"


def test_weights_out_of_bounds_fail_the_trial() -> None:
    trial = replace(TRIAL, policy=Policy("wild", "exact", weights=Weights(1e9, 0.05, 50.0, 50.0)))
    with pytest.raises(Exception, match="tracking"):
        trial.perform()
