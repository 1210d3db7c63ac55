"""The look that everybody shares, over scripted missions; nothing is drawn."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from console.looking import Looking
from server.api.errors import ServiceError
from server.api.models import MissionRequest
from tests.server.api.serving import Stage
from tests.server.waiting import eventually

REQUEST = MissionRequest(scenario="scripted")


class Sight:
    """A service with a mission that has flown for two minutes, and what was shown of it."""

    def __init__(self) -> None:
        self.stage = Stage(period_s=1000.0)
        self.shown: list[dict[str, Any]] = []
        self.looking = Looking(self.stage.service, self.shown.append, self.newest)

    def newest(self) -> dict[str, Any] | None:
        steered = self.looking.steered
        return None if steered is None else self.stage.service.snapshot(steered.id)

    async def fly(self, mission: str, seconds: int) -> None:
        await self.stage.service.create(REQUEST, "operator")
        await self.stage.service.start(mission, "operator")
        for second in range(seconds + 1):
            self.stage.planners[-1].say(float(second))


@asynccontextmanager
async def sight() -> AsyncIterator[Sight]:
    made = Sight()
    async with made.stage.service as service:
        await made.fly("m1", 120)
        made.looking.steer(service.mission("m1"))
        yield made
        made.looking.close()


@pytest.mark.asyncio
async def test_a_minute_back_and_to_the_present_again() -> None:
    async with sight() as seen:
        looking = seen.looking
        await looking.back(60.0, "ada")
        assert (looking.away, looking.at_s, looking.by) == (True, 60.0, "ada")
        assert seen.shown[-1]["time_s"] == 60.0
        seen.stage.planners[0].say(121.0)  # the mission flies on
        assert looking.picture is not None
        assert looking.picture["time_s"] == 60.0
        looking.live()
        assert seen.shown[-1]["time_s"] == 121.0
        assert (looking.at_s, looking.by) == (None, "")


@pytest.mark.asyncio
async def test_before_the_first_picture_lies_the_first_picture() -> None:
    async with sight() as seen:
        (record,) = seen.stage.service.records()
        record.past.clear()
        seen.stage.planners[0].say(121.0)
        await seen.looking.back(111.0, "ada")
        assert seen.looking.at_s == 121.0
        assert seen.shown[-1]["time_s"] == 121.0


@pytest.mark.asyncio
async def test_what_is_not_kept_changes_nothing() -> None:
    async with sight() as seen:
        await seen.looking.back(30.0, "ada")
        (record,) = seen.stage.service.records()
        record.past.clear()
        with pytest.raises(ServiceError, match="nothing is kept"):
            await seen.looking.back(10.0, "ada")
        assert seen.looking.at_s == 30.0
        assert seen.shown[-1]["time_s"] == 30.0


@pytest.mark.asyncio
async def test_the_course_is_that_of_the_mission_looked_at() -> None:
    async with sight() as seen:
        await eventually(lambda: len(seen.looking.course.points) == 121)
        await seen.stage.service.stop("m1", "operator")
        await seen.fly("m2", 5)
        seen.looking.steer(seen.stage.service.mission("m2"))
        await eventually(lambda: len(seen.looking.course.points) == 6)
        assert seen.looking.course_of == "m2"
        await seen.looking.choose("m1", "ada")
        assert seen.looking.away
        assert seen.looking.mission is not None
        assert seen.looking.mission.id == "m1"
        assert seen.shown[-1]["time_s"] == 120.0, "the end of a mission that is over"
        await eventually(lambda: len(seen.looking.course.points) == 121)


@pytest.mark.asyncio
async def test_a_new_mission_takes_the_picture() -> None:
    """Whoever looked at the past must not miss that something flies."""
    async with sight() as seen:
        await seen.looking.back(60.0, "ada")
        await seen.stage.service.stop("m1", "operator")
        await seen.fly("m2", 2)
        seen.looking.steer(seen.stage.service.mission("m2"))
        assert not seen.looking.away


@pytest.mark.asyncio
async def test_choosing_the_steered_mission_is_the_present() -> None:
    async with sight() as seen:
        await seen.looking.back(60.0, "ada")
        await seen.looking.choose("m1", "ada")
        assert not seen.looking.away
        with pytest.raises(ServiceError, match="no mission m9"):
            await seen.looking.choose("m9", "ada")
        assert not seen.looking.away


@pytest.mark.asyncio
async def test_a_mission_that_is_removed_is_no_longer_looked_at() -> None:
    async with sight() as seen:
        service = seen.stage.service
        await service.stop("m1", "operator")
        await seen.fly("m2", 2)
        seen.looking.steer(service.mission("m2"))
        await seen.looking.choose("m1", "ada")
        await service.delete("m1", "operator")
        seen.looking.steer(service.mission("m2"))
        assert not seen.looking.away
        await eventually(lambda: seen.looking.course_of == "m2")
