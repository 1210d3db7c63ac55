"""What everybody looks at: a mission, and of it the present or an instant that is gone.

One look for all browsers, so that everybody speaks of the same picture. It never touches the
mission that is steered: that one flies on, and Hold, comments and overrides go to it.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import structlog

from server.api.errors import ServiceError
from server.api.models import Clock, MissionInfo
from server.api.service import MissionService
from server.course import Course

log = structlog.get_logger(__name__)

Json = dict[str, Any]
Show = Callable[[Json], None]
"""Draws a picture for everybody."""


@dataclass(slots=True)
class Looking:
    """Owner of the look. All methods on the event loop."""

    service: MissionService
    show: Show
    newest: Callable[[], Json | None]
    """Returns the newest picture of the mission that is steered."""

    steered: MissionInfo | None = None
    """The mission that is acted on: the live one, else the newest. Set by the board."""

    picture: Json | None = None
    """What is looked at while that is not the steered mission's present."""

    at_s: float | None = None
    """The instant that is looked at, None for the present. A replay has its own clock."""

    by: str = ""
    """Who chose what is looked at."""

    course: Course = field(default_factory=Course)
    """Of the mission that is looked at."""

    course_of: str = ""
    """Id of that mission; empty for none."""

    _chosen: str | None = None
    _reading: asyncio.Task[None] | None = None
    _task: asyncio.Task[None] | None = None
    _asked: int = 0
    """Counts what was asked for: an older answer never replaces a newer one."""

    @property
    def mission(self) -> MissionInfo | None:
        """The mission that is looked at."""
        if self._chosen is not None:
            try:
                return self.service.mission(self._chosen)
            except ServiceError:
                return self.steered  # it was removed
        return self.steered

    @property
    def away(self) -> bool:
        """Whether something else than the steered mission's present is looked at."""
        return self._chosen is not None or self.at_s is not None

    @property
    def replays(self) -> bool:
        """Whether a recording is looked at, which has a clock of its own."""
        return self.mission is not None and self.mission.clock is Clock.REPLAY

    async def back(self, at_s: float, by: str) -> None:
        """Look at an instant of the mission; a replay goes there for good.

        Before the first picture that is kept lies that picture, so that a few steps back soon
        after the start lead to the start. Raises ServiceError 409 where nothing is kept.
        """
        mission = self.mission
        if mission is None:
            return
        if self.replays:
            duration_s = self.course.until_s
            await self.service.seek(mission.id, min(max(0.0, at_s), duration_s), None)
            return
        asked = self._ask()
        at_s = max(0.0, at_s, self.service.hindsight.kept_from_s(mission.id) or 0.0)
        picture = await self.service.hindsight.picture(mission.id, at_s)
        if asked != self._asked:
            return
        self._end_task()
        self.picture, self.at_s, self.by = picture, at_s, by
        self.show(picture)

    async def choose(self, mission_id: str, by: str) -> None:
        """Look at another mission, at its present or its end. Raises ServiceError 404, 409."""
        if self.steered is not None and mission_id == self.steered.id:
            self.live()
            return
        asked = self._ask()
        picture = await self.service.hindsight.last(mission_id)
        if asked != self._asked:
            return
        self._end_task()
        self.picture, self.at_s, self.by, self._chosen = picture, None, by, mission_id
        if picture is not None:
            self.show(picture)
        self._follow(mission_id)
        self._want_course()

    def live(self) -> None:
        """Look at the steered mission's present again."""
        self._ask()
        self._end_task()
        was_away = self.away
        self.picture, self.at_s, self._chosen, self.by = None, None, None, ""
        if was_away and (newest := self.newest()) is not None:
            self.show(newest)

    def steer(self, mission: MissionInfo | None) -> None:
        """Take note of the mission that is steered; a new one is looked at, at once."""
        if mission is not None and (self.steered is None or mission.id != self.steered.id):
            self.live()
        self.steered = mission
        if self._chosen is not None and self.mission is self.steered:
            self.live()
        self._want_course()

    def close(self) -> None:
        """Stop following and reading."""
        self._end_task()
        if self._reading is not None:
            self._reading.cancel()

    def _want_course(self) -> None:
        """Have the course of the mission that is looked at; it may take a while to be read."""
        mission = self.mission
        wanted = "" if mission is None else mission.id
        if wanted == self.course_of:
            return
        if self._reading is not None:
            self._reading.cancel()
        self.course, self.course_of, self._reading = Course(), wanted, None
        if wanted:
            self._reading = asyncio.create_task(self._read_course(wanted), name=f"read {wanted}")
            self._reading.add_done_callback(_report)

    async def _read_course(self, mission_id: str) -> None:
        try:
            course = await self.service.hindsight.course(mission_id)
        except ServiceError as error:
            log.warning("no course", mission=mission_id, why=error.message)
            return
        if mission_id == self.course_of:
            self.course = course

    def _ask(self) -> int:
        self._asked += 1
        return self._asked

    def _follow(self, mission_id: str) -> None:
        """Follow a mission that is looked at and not steered, for as long as it says anything."""
        self._end_task()
        self._task = asyncio.create_task(self._watch(mission_id), name=f"look at {mission_id}")
        self._task.add_done_callback(_report)

    async def _watch(self, mission_id: str) -> None:
        async with self.service.subscribe(mission_id) as stream:
            async for message in stream:
                if message["type"] == "snapshot":
                    self.picture = message
                    self.show(message)

    def _end_task(self) -> None:
        if self._task is not None:
            self._task.cancel()
            self._task = None


def _report(task: asyncio.Task[None]) -> None:
    if not task.cancelled() and (error := task.exception()) is not None:
        log.warning("a mission can no longer be looked at", why=str(error))
