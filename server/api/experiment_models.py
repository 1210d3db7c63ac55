"""Bodies and answers of the routes of experiments: what `falconer experiment` can be told."""

from datetime import datetime
from http import HTTPStatus
from typing import Annotated, Any, Final, Literal

from pydantic import Discriminator, Field, StrictBool, Tag

from server.api.errors import ServiceError
from server.api.laboratory import Campaign, Progress
from server.api.models import Answer, Body, CommentText, Count, Name, Number
from server.api.service import MissionService
from server.mission.setup import GateMode

MAX_SEEDS: Final = 1000
MAX_STEPS: Final = 100_000
MAX_MODELS: Final = 5
LARGEST_TEAM: Final = 1000
LONGEST_FLIGHT_S: Final = 3600

ROWS_WITHOUT_MODEL: Final = 3
"""Of the ablation: the paper's problem, nobody, our solver; each model adds two."""

TRADE_OFF_ROWS: Final = 8
REASONING_CELLS: Final = 9
"""Numbers of targets times numbers of zones."""

SMALLEST_TEAM: Final = 2

_NO_MODELS: Final = frozenset({"exact", "none"})


class PersonComment(Body):
    """What the person of an experiment says, and when."""

    time_s: Number = Field(ge=0.0, le=1e6, description="Mission time.")
    text: CommentText


Scenario = Annotated[
    Name | dict[str, Any],
    Field(description="A name from GET /scenarios, or a whole scenario as an object."),
]
Models = Annotated[
    list[Name],
    Field(
        min_length=1,
        max_length=MAX_MODELS,
        description="Names from GET /llm-profiles; models only.",
        examples=[["mock"]],
    ),
]
Seeds = Annotated[Count, Field(ge=1, le=MAX_SEEDS, description="Seeds 0 to N-1.")]


class AblationRequest(Body):
    """What optimizer, assignment solver, model and person are worth (the paper's Table I)."""

    kind: Literal["ablation"] = Field("ablation", description="As `falconer experiment`.")
    scenario: Scenario = "ablation"
    llms: Models = Field(default_factory=lambda: ["mock"])
    seeds: Seeds = 10
    steps: Count | None = Field(None, ge=1, le=MAX_STEPS, description="The scenario's if left out.")
    gate: GateMode | None = Field(None, description="The scenario's if left out.")
    comments: list[PersonComment] = Field(
        default_factory=list, max_length=20, description="The paper's person's if left out."
    )
    trade_off: StrictBool = Field(default=False, description="Also fly other weights of safety.")

    def campaign(self, service: MissionService) -> Campaign:
        """Return what to run. Raises ServiceError 422."""
        arguments = [*_models(self.llms, service), "--seeds", str(self.seeds), "--jobs", "1"]
        if self.steps is not None:
            arguments += ["--steps", str(self.steps)]
        if self.gate is not None:
            arguments += ["--gate", self.gate.value]
        if self.trade_off:
            arguments += ["--trade-off"]
        said = [f"{comment.time_s!r}:{comment.text}" for comment in self.comments]
        arguments += _options("--comment", said)
        rows = ROWS_WITHOUT_MODEL + 2 * len(set(self.llms)) + TRADE_OFF_ROWS * self.trade_off
        scenario = service.checked_scenario(self.scenario)
        return Campaign(self.kind, tuple(arguments), self.seeds * rows, scenario)


class ReasoningRequest(Body):
    """How often models answer validly, and in how many tokens (the paper's 3 x 3 grid)."""

    kind: Literal["reasoning"]
    llms: Models = Field(default_factory=lambda: ["mock"])
    seeds: Seeds = 5

    def campaign(self, service: MissionService) -> Campaign:
        """Return what to run. Raises ServiceError 422."""
        arguments = (*_models(self.llms, service), "--seeds", str(self.seeds), "--jobs", "1")
        return Campaign(self.kind, arguments, self.seeds * REASONING_CELLS * len(set(self.llms)))


class ScalingRequest(Body):
    """The time of a tick of the core against the size of the team."""

    kind: Literal["scaling"]
    largest: Count = Field(
        64, ge=SMALLEST_TEAM, le=LARGEST_TEAM, description="Robots of the largest team."
    )
    seeds: Seeds = 3
    steps: Count = Field(
        40, ge=10, le=10_000, description="Ticks of a run, the first five not counted."
    )

    def campaign(self, service: MissionService) -> Campaign:
        """Return what to run."""
        sizes, size = 1, SMALLEST_TEAM
        while size < self.largest:
            sizes, size = sizes + 1, 2 * size
        arguments = ("--largest", str(self.largest), "--seeds", str(self.seeds))
        return Campaign(self.kind, (*arguments, "--steps", str(self.steps)), self.seeds * sizes)


class RuntimeRequest(Body):
    """Rate, run time and success of each module in a live mission (the paper's Table II)."""

    kind: Literal["runtime"]
    scenario: Scenario = "hardware"
    llm: Name = Field("mock", description="A name from GET /llm-profiles.")
    duration_s: Count = Field(
        60, ge=5, le=LONGEST_FLIGHT_S, description="Seconds to fly, in real time."
    )
    gate: GateMode | None = Field(None, description="The scenario's if left out.")

    def campaign(self, service: MissionService) -> Campaign:
        """Return what to run. Raises ServiceError 422."""
        arguments = ["--llm", service.model_address(self.llm), "--duration", str(self.duration_s)]
        if self.gate is not None:
            arguments += ["--gate", self.gate.value]
        return Campaign(self.kind, tuple(arguments), 1, service.checked_scenario(self.scenario))


def _kind_of(body: Any) -> str:
    """Return which request a body is: an ablation where it does not say."""
    told = body.get("kind", "ablation") if isinstance(body, dict) else None
    kind = getattr(body, "kind", told)  # of a body that was read before
    return kind if isinstance(kind, str) else "unknown"


ExperimentRequest = Annotated[
    Annotated[AblationRequest, Tag("ablation")]
    | Annotated[ReasoningRequest, Tag("reasoning")]
    | Annotated[ScalingRequest, Tag("scaling")]
    | Annotated[RuntimeRequest, Tag("runtime")],
    Discriminator(_kind_of),
]
"""A campaign, by its `kind`."""


class ExperimentInfo(Answer):
    """A campaign and how far it is."""

    id: str = Field(examples=["e1"])
    kind: str
    state: Progress
    author: str
    created_at: datetime = Field(description="Wall clock, UTC.")
    runs: int = Field(description="How many missions it flies.")
    done: int = Field(description="How many of them are done.")
    error: str = Field(description="Why it failed, in words; else empty.")


class ExperimentAnswer(ExperimentInfo):
    """The same with what it found."""

    result: dict[str, Any] | None = Field(description="As `falconer experiment --json` prints it.")


class ExperimentPage(Answer):
    """Experiments in the order they were begun."""

    experiments: list[ExperimentInfo]
    next_after: int = Field(description="Pass it as `after` to get those begun later.")


def _models(names: list[str], service: MissionService) -> tuple[str, ...]:
    """Return the options that choose models. Raises ServiceError 422."""
    for name in names:
        if name in _NO_MODELS:
            raise ServiceError(
                "llm_unfit",
                f"{name} is no model; what flies without one is part of the experiment anyway.",
                HTTPStatus.UNPROCESSABLE_ENTITY,
            )
    return tuple(_options("--llm", [service.model_address(name) for name in names]))


def _options(name: str, values: list[str]) -> list[str]:
    return [part for value in values for part in (name, value)]
