"""The routes by which people steer in person, under /api/v1 (docs/gate.md)."""

from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Path

from server.api.directing_models import (
    ApprovalRequest,
    AssignmentRequest,
    CapacitiesRequest,
    DirectionAnswer,
    PinRequest,
    WeightsRequest,
    ZoneAnswer,
    ZoneChangeRequest,
    ZoneRequest,
)
from server.api.missions import (
    Author,
    DecisionPath,
    MissionPath,
    Responses,
    Service,
    change_answers,
)
from server.api.models import ErrorAnswer

PinPath = Annotated[str, Path(pattern=r"^[A-Za-z0-9_.-]{1,64}$", examples=["keep-22-121"])]
ZonePath = Annotated[str, Path(pattern=r"^[A-Za-z0-9_.-]{1,64}$", examples=["h1"])]

_REFUSED: Responses = {**change_answers, HTTPStatus.UNPROCESSABLE_ENTITY: {"model": ErrorAnswer}}

router = APIRouter(prefix="/missions/{mission_id}", tags=["directing"], responses=_REFUSED)


@router.put("/assignment")
async def put_assignment(
    mission_id: MissionPath, body: AssignmentRequest, service: Service, author: Author
) -> DirectionAnswer:
    """Replace the whole assignment; a robot that is left out gets no target."""
    return await _direct(service, mission_id, "assignment", body.model_dump(), author)


@router.put("/weights")
async def put_weights(
    mission_id: MissionPath, body: WeightsRequest, service: Service, author: Author
) -> DirectionAnswer:
    """Replace the four weights."""
    return await _direct(service, mission_id, "weights", {"weights": body.ordered()}, author)


@router.put("/capacities")
async def put_capacities(
    mission_id: MissionPath, body: CapacitiesRequest, service: Service, author: Author
) -> DirectionAnswer:
    """Set the capacities of the robots named; the assignment changes as little as it must."""
    return await _direct(service, mission_id, "capacities", body.model_dump(), author)


@router.put("/pins/{pin_id}")
async def put_pin(
    mission_id: MissionPath, pin_id: PinPath, body: PinRequest, service: Service, author: Author
) -> DirectionAnswer:
    """Keep a robot and a target together, or apart; later proposals must respect it."""
    return await _direct(service, mission_id, "pin", body.model_dump() | {"id": pin_id}, author)


@router.delete("/pins/{pin_id}")
async def delete_pin(
    mission_id: MissionPath, pin_id: PinPath, service: Service, author: Author
) -> DirectionAnswer:
    """Lift a pin, a person's or one that a comment brought about."""
    return await _direct(service, mission_id, "unpin", {"id": pin_id}, author)


@router.post("/zones", status_code=HTTPStatus.CREATED)
async def post_zone(
    mission_id: MissionPath, body: ZoneRequest, service: Service, author: Author
) -> ZoneAnswer:
    """Draw a zone: the whole connected team knows it from the next tick on."""
    return await _zone(service, mission_id, "zone", body.model_dump(), author)


@router.put("/zones/{zone_id}")
async def put_zone(
    mission_id: MissionPath,
    zone_id: ZonePath,
    body: ZoneChangeRequest,
    service: Service,
    author: Author,
) -> ZoneAnswer:
    """Change a known zone: its severity, its place, its size. What is left out stays."""
    asked = body.model_dump() | {"id": zone_id}
    return await _zone(service, mission_id, "zone_change", asked, author)


@router.delete("/zones/{zone_id}")
async def delete_zone(
    mission_id: MissionPath, zone_id: ZonePath, service: Service, author: Author
) -> ZoneAnswer:
    """Erase a known zone. One that is really there comes back when it hits again."""
    return await _zone(service, mission_id, "zone_erase", {"id": zone_id}, author)


@router.post("/approvals/{decision_id}")
async def post_approval(
    mission_id: MissionPath,
    decision_id: DecisionPath,
    body: ApprovalRequest,
    service: Service,
    author: Author,
) -> DirectionAnswer:
    """Approve or refuse a decision that waits for a person."""
    asked = {"id": decision_id, "approve": body.approve}
    return await _direct(service, mission_id, "approval", asked, author)


async def _direct(
    service: Service, mission_id: str, what: str, asked: dict[str, Any], author: str
) -> DirectionAnswer:
    return DirectionAnswer.model_validate(await service.direct(mission_id, what, asked, author))


async def _zone(
    service: Service, mission_id: str, what: str, asked: dict[str, Any], author: str
) -> ZoneAnswer:
    return ZoneAnswer.model_validate(await service.direct(mission_id, what, asked, author))
