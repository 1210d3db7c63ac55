"""The routes of missions, under /api/v1."""

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query, Request

from server.api.errors import ServiceError
from server.api.identity import author_of
from server.api.models import (
    CommentModel,
    CommentRequest,
    DecisionPage,
    ErrorAnswer,
    EventPage,
    HistoryPage,
    LlmProfile,
    MissionInfo,
    MissionRequest,
    Sample,
    ScenarioInfo,
    ScenarioUpload,
)
from server.api.service import MissionService

MAX_PAGE = 1000

MissionPath = Annotated[
    str, Path(pattern=r"^[A-Za-z0-9_-]{1,32}$", description="Of GET /missions.", examples=["m1"])
]
CommentPath = Annotated[str, Path(pattern=r"^[A-Za-z0-9_-]{1,32}$", examples=["c1"])]

DecisionPath = Annotated[str, Path(pattern=r"^d[0-9]{1,9}$", examples=["d1"])]


ScenarioPath = Annotated[
    str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$", examples=["my-scenario"])
]


def service_of(request: Request) -> MissionService:
    """Return the application's mission service."""
    service: MissionService = request.app.state.service
    return service


Service = Annotated[MissionService, Depends(service_of)]
Author = Annotated[str, Depends(author_of)]

Responses = dict[int | str, dict[str, Any]]

_NOT_FOUND: Responses = {HTTPStatus.NOT_FOUND: {"model": ErrorAnswer}}
_JOURNAL: Responses = {**_NOT_FOUND, HTTPStatus.SERVICE_UNAVAILABLE: {"model": ErrorAnswer}}
change_answers: Responses = {
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


@router.post(
    "/scenarios",
    status_code=HTTPStatus.CREATED,
    tags=["catalogue"],
    responses={
        HTTPStatus.CONFLICT: {"model": ErrorAnswer},
        HTTPStatus.SERVICE_UNAVAILABLE: {"model": ErrorAnswer},
    },
)
async def upload_scenario(body: ScenarioUpload, service: Service, author: Author) -> ScenarioInfo:
    """Check a scenario and keep it under its name, for missions to be made from."""
    return await service.shelf.add(body.scenario, author)


@router.get("/scenarios/{name}", tags=["catalogue"], responses=_NOT_FOUND)
async def get_scenario(name: ScenarioPath, service: Service) -> dict[str, Any]:
    """Return a scenario that was uploaded."""
    return service.shelf.one(name)


@router.delete(
    "/scenarios/{name}",
    status_code=HTTPStatus.NO_CONTENT,
    tags=["catalogue"],
    responses={**_NOT_FOUND, HTTPStatus.SERVICE_UNAVAILABLE: {"model": ErrorAnswer}},
)
async def delete_scenario(name: ScenarioPath, service: Service, author: Author) -> None:
    """Forget a scenario that was uploaded."""
    await service.shelf.remove(name, author)


@router.get("/llm-profiles", tags=["catalogue"])
async def list_llm_profiles(service: Service) -> list[LlmProfile]:
    """Return the configured sources of task and action answers."""
    return list(service.profiles())


@router.post(
    "/missions",
    status_code=HTTPStatus.CREATED,
    tags=["missions"],
    responses={
        HTTPStatus.CONFLICT: {"model": ErrorAnswer},
        HTTPStatus.SERVICE_UNAVAILABLE: {"model": ErrorAnswer},
    },
)
async def create_mission(body: MissionRequest, service: Service, author: Author) -> MissionInfo:
    """Make a mission from a scenario. It starts when told to."""
    return await service.create(body, author)


@router.get("/missions", tags=["missions"])
async def list_missions(
    service: Service,
    after: Annotated[int, Query(ge=0, le=2**53, description="Number of a mission.")] = 0,
    limit: Annotated[int, Query(ge=1, le=MAX_PAGE)] = 100,
) -> list[MissionInfo]:
    """Return missions after a number (that of m7 is 7), oldest first."""
    return [m for m in service.missions() if int(m.id[1:]) > after][:limit]


@router.get("/missions/{mission_id}", tags=["missions"], responses=_NOT_FOUND)
async def get_mission(mission_id: MissionPath, service: Service) -> MissionInfo:
    """Return one mission."""
    return service.mission(mission_id)


@router.delete(
    "/missions/{mission_id}",
    status_code=HTTPStatus.NO_CONTENT,
    tags=["missions"],
    responses=change_answers,
)
async def delete_mission(mission_id: MissionPath, service: Service, author: Author) -> None:
    """Forget a mission that does not fly. Its journal stays."""
    await service.delete(mission_id, author)


@router.post("/missions/{mission_id}/start", tags=["steering"], responses=change_answers)
async def start_mission(mission_id: MissionPath, service: Service, author: Author) -> MissionInfo:
    """Start a mission, or a failed one again. A live one stays as it is."""
    return await service.start(mission_id, author)


@router.post("/missions/{mission_id}/pause", tags=["steering"], responses=change_answers)
async def pause_mission(mission_id: MissionPath, service: Service, author: Author) -> MissionInfo:
    """Let mission time stand still. Vehicles hold."""
    return await service.pause(mission_id, author)


@router.post("/missions/{mission_id}/resume", tags=["steering"], responses=change_answers)
async def resume_mission(mission_id: MissionPath, service: Service, author: Author) -> MissionInfo:
    """Go on after hold or pause."""
    return await service.resume(mission_id, author)


@router.post("/missions/{mission_id}/hold", tags=["steering"], responses=change_answers)
async def hold_mission(mission_id: MissionPath, service: Service, author: Author) -> MissionInfo:
    """Stop every vehicle where it is, now."""
    return await service.hold(mission_id, author)


@router.post("/missions/{mission_id}/stop", tags=["steering"], responses=change_answers)
async def stop_mission(mission_id: MissionPath, service: Service, author: Author) -> MissionInfo:
    """End a mission for good."""
    return await service.stop(mission_id, author)


@router.get(
    "/missions/{mission_id}/snapshot",
    tags=["looking"],
    responses={**_NOT_FOUND, HTTPStatus.CONFLICT: {"model": ErrorAnswer}},
)
async def get_snapshot(
    mission_id: MissionPath,
    service: Service,
    at_s: Annotated[
        float | None,
        Query(ge=0.0, le=1e9, description="Mission time; the newest snapshot if left out."),
    ] = None,
) -> dict[str, Any]:
    """Return the newest snapshot, or the newest at or before a mission time, as on the stream."""
    if at_s is not None:
        return await service.hindsight.picture(mission_id, at_s)
    snapshot = await service.hindsight.last(mission_id)
    if snapshot is None:
        raise ServiceError(
            "no_snapshot",
            service.hindsight.absence(mission_id),
            HTTPStatus.CONFLICT,
        )
    return snapshot


@router.get("/missions/{mission_id}/events", tags=["looking"], responses=_JOURNAL)
async def list_events(
    mission_id: MissionPath,
    service: Service,
    after: Annotated[int, Query(ge=0, le=2**53, description="A sequence number.")] = 0,
    limit: Annotated[int, Query(ge=1, le=MAX_PAGE)] = 100,
) -> EventPage:
    """Return events after a sequence number, oldest first."""
    events = await service.events(mission_id, after, limit)
    return EventPage(events=events, next_after=events[-1]["seq"] if events else after)


@router.get("/missions/{mission_id}/decisions", tags=["looking"], responses=_NOT_FOUND)
async def list_decisions(
    mission_id: MissionPath,
    service: Service,
    after: Annotated[int, Query(ge=0, le=2**53, description="Number of a decision.")] = 0,
    limit: Annotated[int, Query(ge=1, le=MAX_PAGE)] = 100,
) -> DecisionPage:
    """Return decision cards after a number, oldest first."""
    cards = service.decisions(mission_id, after, limit)
    last = int(cards[-1]["id"][1:]) if cards else after
    return DecisionPage(decisions=cards, next_after=last)


@router.get(
    "/missions/{mission_id}/decisions/{decision_id}", tags=["looking"], responses=_NOT_FOUND
)
async def get_decision(
    mission_id: MissionPath, decision_id: DecisionPath, service: Service
) -> dict[str, Any]:
    """Return one decision card, with the prompts and raw answers behind it."""
    return service.decision(mission_id, decision_id)


@router.get("/missions/{mission_id}/history", tags=["looking"], responses=_JOURNAL)
async def list_history(
    mission_id: MissionPath,
    service: Service,
    after: Annotated[int, Query(ge=0, le=2**53, description="A sample's number.")] = 0,
    limit: Annotated[int, Query(ge=1, le=MAX_PAGE)] = 100,
) -> HistoryPage:
    """Return the mission's figures, one sample per second of mission time, oldest first."""
    samples = await service.history(mission_id, after, limit)
    return HistoryPage(
        samples=[Sample.model_validate(sample) for sample in samples],
        next_after=samples[-1]["seq"] if samples else after,
    )


@router.get("/missions/{mission_id}/result", tags=["looking"], responses=change_answers)
async def get_result(mission_id: MissionPath, service: Service) -> dict[str, Any]:
    """Return the mission's figures, so far or final."""
    return await service.result(mission_id)


@router.post(
    "/missions/{mission_id}/comments",
    status_code=HTTPStatus.CREATED,
    tags=["comments"],
    responses={**change_answers, HTTPStatus.TOO_MANY_REQUESTS: {"model": ErrorAnswer}},
)
async def create_comment(
    mission_id: MissionPath, body: CommentRequest, service: Service, author: Author
) -> CommentModel:
    """Give the models a sentence to consider. Its receipt tells what becomes of it."""
    return await service.comment(mission_id, body.text, author)


@router.get("/missions/{mission_id}/comments", tags=["comments"], responses=_NOT_FOUND)
async def list_comments(
    mission_id: MissionPath,
    service: Service,
    after: Annotated[int, Query(ge=0, le=2**53, description="Number of a comment.")] = 0,
    limit: Annotated[int, Query(ge=1, le=MAX_PAGE)] = MAX_PAGE,
) -> list[CommentModel]:
    """Return a mission's comments after a number (that of c7 is 7) with their receipts."""
    return [c for c in service.comments(mission_id) if int(c.id[1:]) > after][:limit]


@router.get("/missions/{mission_id}/comments/{comment_id}", tags=["comments"], responses=_NOT_FOUND)
async def get_comment(
    mission_id: MissionPath, comment_id: CommentPath, service: Service
) -> CommentModel:
    """Return one comment with its receipt."""
    return service.comment_by_id(mission_id, comment_id)
