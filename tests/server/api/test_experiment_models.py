"""What can be asked of experiments over HTTP, beside what the command line would do of it."""

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError
from typer.testing import CliRunner

from server.api.errors import ServiceError
from server.api.experiment_models import ExperimentRequest
from server.api.laboratory import Campaign
from server.api.library import ScenarioLibrary
from server.api.service import MissionService
from server.cli.app import app
from server.experiments.ablation import AblationPlan, person
from server.experiments.reasoning import ReasoningPlan
from server.experiments.scaling import ScalingPlan
from server.mission.setup import GateMode
from server.scenarios import library
from server.settings import Settings
from tests.server.api.serving import Stage

REQUEST: TypeAdapter[Any] = TypeAdapter(ExperimentRequest)


@pytest.fixture
def service() -> MissionService:
    stage = Stage()
    return MissionService(
        ScenarioLibrary(Settings()), stage.planner, stage.world, stage.service._journal
    )


def campaign(service: MissionService, **body: Any) -> Campaign:
    made: Campaign = REQUEST.validate_python(body).campaign(service)
    return made


@pytest.mark.parametrize("trade_off", [False, True])
def test_runs_of_an_ablation_are_counted(service: MissionService, trade_off: bool) -> None:
    asked = campaign(service, seeds=7, llms=["mock"], trade_off=trade_off)
    scenario = library.named("ablation")
    plan = AblationPlan(
        scenario=scenario,
        llms=("mock",),
        seeds=tuple(range(7)),
        gate=GateMode.OFF,
        engine="sqp",
        comments=person(scenario),
        trade_off=trade_off,
    )
    assert asked.runs == len(plan.trials())


def test_runs_of_the_others_are_counted(service: MissionService) -> None:
    asked = campaign(service, kind="reasoning", seeds=3)
    assert asked.runs == len(ReasoningPlan(("mock",), ("mock",), (0, 1, 2), "sqp").trials())
    for largest in (2, 3, 64, 1000):
        asked = campaign(service, kind="scaling", largest=largest, seeds=2, steps=20)
        assert asked.runs == len(ScalingPlan(largest, (0, 1), "sqp", 20).trials())
    assert campaign(service, kind="runtime", duration_s=5).runs == 1


@pytest.mark.parametrize(
    "body",
    [
        {"seeds": 2, "steps": 10, "gate": "auto", "trade_off": True,
         "comments": [{"time_s": 3.0, "text": "Track more boldly."}]},
        {"kind": "reasoning", "seeds": 2},
        {"kind": "scaling", "largest": 4, "seeds": 1, "steps": 10},
        {"kind": "runtime", "duration_s": 5, "gate": "confirm"},
    ],
)  # fmt: skip
def test_the_command_line_knows_every_option(service: MissionService, body: dict[str, Any]) -> None:
    """Each option stands in the help of the command that would run it."""
    asked = campaign(service, **body)
    shown = CliRunner(env={"COLUMNS": "200", "TERM": "dumb"}).invoke(
        app, ["experiment", asked.kind, "--help"]
    )
    assert shown.exit_code == 0
    options = [word for word in asked.arguments if word.startswith("--")]
    assert options
    for option in (*options, "--out", "--json"):
        assert option in shown.output


@pytest.mark.parametrize(
    "body",
    [
        {"kind": "sweep"},
        {"kind": ["ablation"]},
        {"seeds": 0},
        {"seeds": 1001},
        {"seeds": True},
        {"llms": []},
        {"llms": ["http://10.0.0.1"]},
        {"kind": "reasoning", "scenario": "demo"},
        {"kind": "reasoning", "seeds": "5"},
        {"kind": "scaling", "largest": 1},
        {"kind": "scaling", "largest": 1001},
        {"kind": "scaling", "steps": 9},
        {"kind": "scaling", "llms": ["mock"]},
        {"kind": "runtime", "duration_s": 4},
        {"kind": "runtime", "duration_s": 4000},
        {"kind": "runtime", "gate": "never"},
        {"kind": "runtime", "seeds": 3},
    ],
)
def test_what_no_command_would_take_is_refused(body: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        REQUEST.validate_python(body)


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ({"llms": ["exact"]}, "llm_unfit"),
        ({"kind": "reasoning", "llms": ["none"]}, "llm_unfit"),
        ({"llms": ["gpt"]}, "llm_unknown"),
        ({"kind": "runtime", "llm": "gpt"}, "llm_unknown"),
        ({"kind": "runtime", "scenario": "nowhere"}, "scenario_invalid"),
        ({"scenario": {"name": "x"}}, "scenario_invalid"),
    ],
)
def test_what_this_server_does_not_have_is_refused(
    service: MissionService, body: dict[str, Any], code: str
) -> None:
    with pytest.raises(ServiceError) as refused:
        campaign(service, **body)
    assert refused.value.code == code
    assert refused.value.status == 422
