"""Bodies and answers of the REST interface (docs/reference/api.md)."""

from datetime import datetime
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from server.encoding import MissionState
from server.mission.setup import GateMode

MAX_COMMENT_CHARACTERS = 2000
MAX_SEED = 2**63 - 1

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
CommentText = Annotated[
    str,
    StringConstraints(
        strip_whitespace=True,
        min_length=1,
        max_length=MAX_COMMENT_CHARACTERS,
        pattern=r"^[^\x00]*$",
    ),
]
"""Anything but the character NUL, which no process takes as an argument."""


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]
"""Numbers of request bodies: true is none of them."""


class Body(BaseModel):
    """A request body: unknown fields are refused, so that a typing error is noticed."""

    model_config = ConfigDict(extra="forbid")


class Answer(BaseModel):
    """A response."""

    model_config = ConfigDict(frozen=True)


class ErrorDetail(Answer):
    """What went wrong."""

    code: str = Field(description="Stable, for programs.", examples=["mission_unknown"])
    message: str = Field(description="One sentence, for people.")
    details: dict[str, Any] = Field(description="More, depending on the code.")


class ErrorAnswer(Answer):
    """The one error shape."""

    error: ErrorDetail


class ScenarioInfo(Answer):
    """A scenario that a mission can be made from."""

    name: str = Field(examples=["demo"])
    description: str
    robots: int
    targets: int
    zones: int


class ScenarioUpload(Body):
    """A scenario to be kept."""

    scenario: dict[str, Any] = Field(
        description="A whole scenario; it is kept under its own name.",
        examples=[{"name": "my-scenario"}],
    )


class LlmProfile(Answer):
    """A configured source of task and action answers."""

    name: str = Field(examples=["mock"])
    description: str


class Clock(StrEnum):
    """Which time a mission runs on."""

    REALTIME = "realtime"
    LOCKSTEP = "lockstep"
    """Virtual time, as fast as it goes; several at once, each waiting for its turn."""

    REPLAY = "replay"
    """A recording's; see POST /recordings/{name}/replay."""


class MissionRequest(Body):
    """What a mission is made from."""

    scenario: Name | dict[str, Any] = Field(
        description="A name from GET /scenarios, or a whole scenario as an object.",
        examples=["demo"],
    )
    llm: Name = Field("mock", description="A name from GET /llm-profiles.")
    gate: GateMode | None = Field(
        None, description="What a verified proposal must still pass; the scenario's if left out."
    )
    clock: Literal[Clock.REALTIME, Clock.LOCKSTEP] = Clock.REALTIME
    seed: Count | None = Field(
        None,
        ge=0,
        le=MAX_SEED,
        description="Of the simulated world's dice; the scenario's own when left out.",
    )


class MissionInfo(Answer):
    """A mission and where it stands."""

    id: str = Field(examples=["m1"])
    scenario: str
    state: MissionState
    clock: Clock
    llm: str
    gate: GateMode = Field(description="What a verified proposal must still pass.")
    seed: int
    created_at: datetime = Field(description="Wall clock, UTC.")
    started_at: datetime | None = Field(description="Wall clock, UTC.")
    time_s: float | None = Field(description="Mission time of the newest snapshot.")
    reason: str = Field(description="Why it ended or failed, in words; else empty.")


class CommentRequest(Body):
    """One sentence, or a few, for the models to consider."""

    text: CommentText = Field(
        examples=["The Drone 21 should focus on tracking target 122."],
    )


class LoopAnswer(Answer):
    """What one loop made of a comment."""

    verdict: Literal["applied", "partly_applied", "declined", "noted"]
    reason: str
    feedback: str = Field("", description="The model's own words, said with the answer.")
    proposal: str = Field(
        "", description="Id of the proposal that answered; decisions name theirs."
    )


class CommentModel(Answer):
    """A comment and its receipt."""

    id: str = Field(examples=["c1"])
    text: str
    author: str
    time_s: float = Field(description="Mission time at which it was received.")
    status: Literal[
        "received", "considered", "applied", "partly_applied", "noted", "declined", "expired"
    ]
    task: LoopAnswer | None = Field(description="The task model's answer, if it gave one yet.")
    action: LoopAnswer | None = Field(description="The action model's answer.")


class EventPage(Answer):
    """Events in the order they happened."""

    events: list[dict[str, Any]] = Field(description="As on the stream.")
    next_after: int = Field(description="Pass it as `after` to get what came later.")


class DecisionPage(Answer):
    """Decision cards in the order of their numbers."""

    decisions: list[dict[str, Any]] = Field(description="As in events of kind `decision`.")
    next_after: int = Field(description="Pass it as `after` to get what came later.")


class Sample(Answer):
    """The figures of one moment."""

    seq: int = Field(description="Number of the sample within its mission, from 1.")
    at: datetime = Field(description="Wall clock, UTC.")
    time_s: float = Field(description="Mission time.")
    state: MissionState
    trace: float | None = Field(description="Sum over targets of the trace, m².")
    attacks: dict[str, int] = Field(description="Hits so far, per kind of zone.")
    weights: dict[str, float]
    solve_ms: float | None
    rung: str | None
    guidance: str
    loops: dict[str, float | None] = Field(description="Success rate of each loop.")


class HistoryPage(Answer):
    """Samples in the order they were taken."""

    samples: list[Sample]
    next_after: int = Field(description="Pass it as `after` to get what came later.")


class Health(Answer):
    """Whether the server lives."""

    status: Literal["ok"]


class Readiness(Answer):
    """Whether the server can take missions, and how the live one does."""

    status: Literal["ready", "degraded"]
    reason: str = Field(description="What is degraded, in words; else empty.")
    live_mission: str | None
    readers: int = Field(description="Open stream subscriptions of the live mission.")
