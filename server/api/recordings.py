"""The routes of recordings: what was flown, to be looked at again and flown on otherwise."""

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Request
from pydantic import Field

from server.api.archive import Archive
from server.api.missions import MissionPath, Responses, Service
from server.api.models import (
    Answer,
    Body,
    CommentText,
    Count,
    ErrorAnswer,
    MissionInfo,
    Name,
    Number,
)
from server.mission.setup import GateMode

MAX_COMMENTS = 20

RecordingPath = Annotated[
    str,
    Path(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,120}\.mcap$",
        description="Of GET /recordings.",
        examples=["demo-20300101T120000000000Z.mcap"],
    ),
]

_REFUSALS: Responses = {
    status: {"model": ErrorAnswer}
    for status in (HTTPStatus.NOT_FOUND, HTTPStatus.CONFLICT, HTTPStatus.SERVICE_UNAVAILABLE)
}


class RecordingInfo(Answer):
    """One recording. What is None could not be read; `error` says why."""

    name: str
    size_bytes: int
    error: str | None
    duration_s: float | None = None
    complete: bool | None = Field(None, description="Whether its writer finished it.")
    mission: str | None = None
    scenario: str | None = None
    clock: str | None = None
    llm: str | None = None
    gate: str | None = None
    seed: int | None = None
    engine: str | None = None
    robots: int | None = None
    targets: int | None = None
    tick_s: float | None = None
    started_at: str | None = None
    falconer: str | None = None


class SeekRequest(Body):
    """Where to go in a replay, and how fast from there."""

    time_s: Number = Field(ge=0.0, description="Mission time.", examples=[42.0])
    speed: Number | None = Field(None, ge=0.1, le=50.0, description="1 is as it was flown.")


class ForkComment(Body):
    """Something said in a fork."""

    time_s: Number = Field(ge=0.0, description="Mission time.")
    text: CommentText


class ForkRequest(Body):
    """From when a recorded mission is flown on, and what is different from there."""

    at_s: Number = Field(ge=0.0, description="Mission time of the fork.", examples=[60.0])
    llm: Name = Field("mock", description="A name from GET /llm-profiles.")
    gate: GateMode | None = Field(None, description="Another gate from here on.")
    seed: Count | None = Field(None, ge=0, le=2**63 - 1, description="Other dice from here on.")
    comments: tuple[ForkComment, ...] = Field((), max_length=MAX_COMMENTS)


router = APIRouter(
    tags=["recordings"],
    responses={
        status: {"model": ErrorAnswer}
        for status in (HTTPStatus.UNPROCESSABLE_ENTITY, HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
    },
)


def archive_of(request: Request) -> Archive:
    """Return the application's archive."""
    archive: Archive = request.app.state.archive
    return archive


Recordings = Annotated[Archive, Depends(archive_of)]


@router.get("/recordings")
async def list_recordings(archive: Recordings) -> list[RecordingInfo]:
    """Return the recordings of this server, newest first."""
    return [RecordingInfo.model_validate(info) for info in await archive.recordings()]


@router.post("/recordings/{name}/replay", status_code=HTTPStatus.CREATED, responses=_REFUSALS)
async def replay_recording(name: RecordingPath, archive: Recordings) -> MissionInfo:
    """Show a recording as a mission of its own, with a stream; pause, resume and seek it."""
    return await archive.replay(name)


@router.post("/missions/{mission_id}/seek", responses=_REFUSALS)
async def seek_mission(mission_id: MissionPath, body: SeekRequest, service: Service) -> MissionInfo:
    """Go to an instant of a replay."""
    return await service.seek(mission_id, body.time_s, body.speed)


@router.post(
    "/missions/{mission_id}/fork",
    responses={**_REFUSALS, HTTPStatus.TOO_MANY_REQUESTS: {"model": ErrorAnswer}},
)
async def fork_mission(
    mission_id: MissionPath, body: ForkRequest, archive: Recordings
) -> dict[str, Any]:
    """Fly a recorded mission on from an instant in lockstep, otherwise, and compare."""
    said = [(comment.time_s, comment.text) for comment in body.comments]
    return await archive.fork(mission_id, body.at_s, body.llm, body.gate, body.seed, said)
