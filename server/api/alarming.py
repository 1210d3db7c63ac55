"""The routes of alarms, under /api/v1."""

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Path, Query

from server.api.alarm_models import ALARM_ID, Alarm, AlarmPage
from server.api.missions import MAX_PAGE, Author, MissionPath, Service
from server.api.models import ErrorAnswer

AlarmPath = Annotated[str, Path(pattern=ALARM_ID, examples=["link-21"])]

router = APIRouter(
    prefix="/missions/{mission_id}/alarms",
    tags=["alarms"],
    responses={
        status: {"model": ErrorAnswer}
        for status in (HTTPStatus.NOT_FOUND, HTTPStatus.UNPROCESSABLE_ENTITY)
    },
)


@router.get("")
async def list_alarms(
    mission_id: MissionPath,
    service: Service,
    after: Annotated[int, Query(ge=0, le=2**53, description="An alarm's number.")] = 0,
    limit: Annotated[int, Query(ge=1, le=MAX_PAGE)] = 100,
) -> AlarmPage:
    """Return alarms after a number, the first raised first."""
    found = [alarm for alarm in service.watch.alarms(mission_id) if alarm.number > after][:limit]
    return AlarmPage(alarms=found, next_after=found[-1].number if found else after)


@router.post("/{alarm_id}/acknowledge")
async def acknowledge_alarm(
    mission_id: MissionPath, alarm_id: AlarmPath, service: Service, author: Author
) -> Alarm:
    """Take note of an alarm. Once is enough: the first name stays until it is raised anew."""
    return service.watch.acknowledge(mission_id, alarm_id, author)
