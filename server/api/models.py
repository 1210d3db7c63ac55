"""Bodies and answers of the REST interface (docs/reference/api.md)."""

from datetime import datetime
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from server.encoding import MissionState

MAX_COMMENT_CHARACTERS = 2000
MAX_SEED = 2**63 - 1

MissionId = Annotated[str, StringConstraints(pattern=r"^m[0-9]{1,9}$")]
CommentId = Annotated[str, StringConstraints(pattern=r"^c[0-9]{1,9}$")]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
CommentText = Annotated[
    str,
    StringConstraints(strip_whitespace=True, min_length=1, max_length=MAX_COMMENT_CHARACTERS),
]


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


class LlmProfile(Answer):
    """A configured source of task and action answers."""

    name: str = Field(examples=["mock"])
    description: str


class Clock(StrEnum):
    """Which time a mission runs on."""

    REALTIME = "realtime"


class MissionRequest(Body):
    """What a mission is made from."""

    scenario: Name | dict[str, Any] = Field(
        description="A name from GET /scenarios, or a whole scenario as an object.",
        examples=["demo"],
    )
    llm: Name = Field("mock", description="A name from GET /llm-profiles.")
    clock: Clock = Clock.REALTIME
    seed: int | None = Field(
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


class Health(Answer):
    """Whether the server lives."""

    status: Literal["ok"]


class Readiness(Answer):
    """Whether the server can take missions, and how the live one does."""

    status: Literal["ready"]
    live_mission: str | None
    readers: int = Field(description="Open stream subscriptions of the live mission.")
