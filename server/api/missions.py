"""The routes of missions, under /api/v1."""

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query, Request

from server.api.errors import ServiceError
from server.api.models import (
    CommentModel,
    CommentRequest,
    ErrorAnswer,
    EventPage,
    LlmProfile,
    MissionInfo,
    MissionRequest,
    ScenarioInfo,
)
from server.api.security import author_of
from server.api.service import MissionService

MAX_PAGE = 1000

MissionPath = Annotated[
    str, Path(pattern=r"^[A-Za-z0-9_-]{1,32}$", description="Of GET /missions.", examples=["m1"])
]
CommentPath = Annotated[str, Path(pattern=r"^[A-Za-z0-9_-]{1,32}$", examples=["c1"])]


def service_of(request: Request) -> MissionService:
    """Return the application's mission service."""
    service: MissionService = request.app.state.service
    return service


Service = Annotated[MissionService, Depends(service_of)]
Author = Annotated[str, Depends(author_of)]

Responses = dict[int | str, dict[str, Any]]

_NOT_FOUND: Responses = {HTTPStatus.NOT_FOUND: {"model": ErrorAnswer}}
_CHANGE: Responses = {
    **_NOT_FOUND,
    HTTPStatus.CONFLICT: {"model": ErrorAnswer},
    HTTPStatus.SERVICE_UNAVAILABLE: {"model": ErrorAnswer},
}

router = APIRouter(
    responses={
        status: {"model": ErrorAnswer}
        for status in (HTTPStatus.UNPROCESSABLE_ENTITY, HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
    }
)


@router.get("/scenarios", tags=["catalogue"])
async def list_scenarios(service: Service) -> list[ScenarioInfo]:
    """Return the scenarios that are known by name."""
    return list(service.scenarios())


@router.get("/llm-profiles", tags=["catalogue"])
async def list_llm_profiles(service: Service) -> list[LlmProfile]:
    """Return the configured sources of task and action answers."""
    return list(service.profiles())


@router.post(
    "/missions",
    status_code=HTTPStatus.CREATED,
    tags=["missions"],
    responses={HTTPStatus.CONFLICT: {"model": ErrorAnswer}},
)
async def create_mission(body: MissionRequest, service: Service) -> MissionInfo:
    """Make a mission from a scenario. It starts when told to."""
    return await service.create(body)


@router.get("/missions", tags=["missions"])
async def list_missions(service: Service) -> list[MissionInfo]:
    """Return all missions, oldest first."""
    return list(service.missions())


@router.get("/missions/{mission_id}", tags=["missions"], responses=_NOT_FOUND)
async def get_mission(mission_id: MissionPath, service: Service) -> MissionInfo:
    """Return one mission."""
    return service.mission(mission_id)


@router.delete(
    "/missions/{mission_id}",
    status_code=HTTPStatus.NO_CONTENT,
    tags=["missions"],
    responses=_CHANGE,
)
async def delete_mission(mission_id: MissionPath, service: Service) -> None:
    """Forget a mission that does not fly."""
    await service.delete(mission_id)


@router.post("/missions/{mission_id}/start", tags=["steering"], responses=_CHANGE)
async def start_mission(mission_id: MissionPath, service: Service, author: Author) -> MissionInfo:
    """Start a mission, or a failed one again. A live one stays as it is."""
    return await service.start(mission_id, author)


@router.post("/missions/{mission_id}/pause", tags=["steering"], responses=_CHANGE)
async def pause_mission(mission_id: MissionPath, service: Service, author: Author) -> MissionInfo:
    """Let mission time stand still. Vehicles hold."""
    return await service.pause(mission_id, author)


@router.post("/missions/{mission_id}/resume", tags=["steering"], responses=_CHANGE)
async def resume_mission(mission_id: MissionPath, service: Service, author: Author) -> MissionInfo:
    """Go on after hold or pause."""
    return await service.resume(mission_id, author)


@router.post("/missions/{mission_id}/hold", tags=["steering"], responses=_CHANGE)
async def hold_mission(mission_id: MissionPath, service: Service, author: Author) -> MissionInfo:
    """Stop every vehicle where it is, now."""
    return await service.hold(mission_id, author)


@router.post("/missions/{mission_id}/stop", tags=["steering"], responses=_CHANGE)
async def stop_mission(mission_id: MissionPath, service: Service, author: Author) -> MissionInfo:
    """End a mission for good."""
    return await service.stop(mission_id, author)


@router.get(
    "/missions/{mission_id}/snapshot",
    tags=["looking"],
    responses={**_NOT_FOUND, HTTPStatus.CONFLICT: {"model": ErrorAnswer}},
)
async def get_snapshot(mission_id: MissionPath, service: Service) -> dict[str, Any]:
    """Return the newest snapshot, as on the stream."""
    snapshot = service.snapshot(mission_id)
    if snapshot is None:
        raise ServiceError(
            "no_snapshot",
            f"Mission {mission_id} has not flown yet.",
            HTTPStatus.CONFLICT,
        )
    return snapshot


@router.get("/missions/{mission_id}/events", tags=["looking"], responses=_NOT_FOUND)
async def list_events(
    mission_id: MissionPath,
    service: Service,
    after: Annotated[int, Query(ge=0, le=2**53, description="A sequence number.")] = 0,
    limit: Annotated[int, Query(ge=1, le=MAX_PAGE)] = 100,
) -> EventPage:
    """Return events after a sequence number, oldest first."""
    events = service.events(mission_id, after, limit)
    return EventPage(events=events, next_after=events[-1]["seq"] if events else after)


@router.get("/missions/{mission_id}/result", tags=["looking"], responses=_CHANGE)
async def get_result(mission_id: MissionPath, service: Service) -> dict[str, Any]:
    """Return the mission's figures, so far or final."""
    return await service.result(mission_id)


@router.post(
    "/missions/{mission_id}/comments",
    status_code=HTTPStatus.CREATED,
    tags=["comments"],
    responses={**_CHANGE, HTTPStatus.TOO_MANY_REQUESTS: {"model": ErrorAnswer}},
)
async def create_comment(
    mission_id: MissionPath, body: CommentRequest, service: Service, author: Author
) -> CommentModel:
    """Give the models a sentence to consider. Its receipt tells what becomes of it."""
    return await service.comment(mission_id, body.text, author)


@router.get("/missions/{mission_id}/comments", tags=["comments"], responses=_NOT_FOUND)
async def list_comments(mission_id: MissionPath, service: Service) -> list[CommentModel]:
    """Return a mission's comments with their receipts, oldest first."""
    return list(service.comments(mission_id))


@router.get("/missions/{mission_id}/comments/{comment_id}", tags=["comments"], responses=_NOT_FOUND)
async def get_comment(
    mission_id: MissionPath, comment_id: CommentPath, service: Service
) -> CommentModel:
    """Return one comment with its receipt."""
    return service.comment_by_id(mission_id, comment_id)
