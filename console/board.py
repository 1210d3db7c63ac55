"""What the console shows, kept once for all browsers: the server's state, not the page's.

One task follows the mission that matters (the live one, else the newest) and draws the scene;
every page only copies from here what has changed.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from html import escape
from typing import Any

import structlog

from console import render
from console.scene import Scene
from server.api.models import MissionInfo
from server.api.service import MissionService

log = structlog.get_logger(__name__)

LOOK_S = 0.3
"""How often to look for another mission."""

PANEL_S = 0.25
"""How often panels change at most."""

EVENTS_SHOWN = 60
COMMENTS_SHOWN = 40

Json = dict[str, Any]


@dataclass(slots=True)
class Board:
    """The newest picture of one mission, with its panels rendered once."""

    service: MissionService
    open_scene: Callable[[], Scene]
    scene: Scene | None = None
    mission: MissionInfo | None = None
    snapshot: Json | None = None
    panels: dict[str, str] = field(default_factory=dict)
    """HTML by panel name."""

    version: int = 0
    """Counts changes of `panels`."""

    _task: asyncio.Task[None] | None = None
    _rendered_s: float = 0.0
    _events_seq: int = -1

    async def start(self) -> None:
        """Open the scene and begin to follow missions."""
        self.scene = await asyncio.to_thread(self.open_scene)
        self._task = asyncio.create_task(self._follow(), name="console board")
        self._task.add_done_callback(_report)

    async def stop(self) -> None:
        """Stop following and close the scene."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        if self.scene is not None:
            scene, self.scene = self.scene, None
            await asyncio.to_thread(scene.close)

    async def _follow(self) -> None:
        while True:
            mission = self._choose()
            if mission is None:
                self._show_nothing()
                await asyncio.sleep(LOOK_S)
            else:
                await self._watch(mission)

    def _choose(self) -> MissionInfo | None:
        """Return the live mission, else the newest one."""
        missions = self.service.missions()
        return self.service.live_mission() or (missions[-1] if missions else None)

    async def _watch(self, mission: MissionInfo) -> None:
        """Show one mission until another one matters."""
        if self.mission is None or self.mission.id != mission.id:
            self.snapshot, self._events_seq = None, -1
        async with self.service.subscribe(mission.id) as stream:
            while (chosen := self._choose()) is not None and chosen.id == mission.id:
                self.mission = chosen
                try:
                    async with asyncio.timeout(LOOK_S):
                        message = await anext(stream)
                except TimeoutError:
                    self._render()
                    continue
                except StopAsyncIteration:
                    return
                if message["type"] == "snapshot":
                    self._take(message)
                self._render()

    def _take(self, snapshot: Json) -> None:
        self.snapshot = snapshot
        if self.scene is not None:
            self.scene.note(snapshot)
            if self.scene.watched:
                self.scene.draw(snapshot)

    def _show_nothing(self) -> None:
        if self.mission is not None or not self.panels:
            self.mission, self.snapshot = None, None
            self._put({"mission": _no_mission()})

    def _render(self) -> None:
        """Render the panels again, not more often than they can be read."""
        now_s = asyncio.get_running_loop().time()
        if self.mission is None or now_s - self._rendered_s < PANEL_S:
            return
        self._rendered_s = now_s
        mission, snapshot = self.mission, self.snapshot
        recent = self.service.recent_events(mission.id, EVENTS_SHOWN)
        comments = self.service.comments(mission.id)[-COMMENTS_SHOWN:]
        panels = {
            "mission": _mission_line(mission),
            "receipts": render.receipts(comment.model_dump() for comment in comments),
            "events": render.events(recent),
        }
        if snapshot is not None:
            panels |= {
                "clock": render.clock(snapshot["time_s"]),
                "lamps": render.lamps(snapshot),
                "guidance": render.guidance(snapshot),
                "figures": render.figures(snapshot),
                "team": render.team(snapshot),
                "matrix": render.matrix(snapshot),
                "assignment_note": render.assignment_note(snapshot),
                "weights": render.weights(snapshot),
                "weights_note": render.weights_note(snapshot),
            }
        self._put(panels)

    def _put(self, panels: dict[str, str]) -> None:
        if panels != self.panels:
            self.panels = panels
            self.version += 1


def _mission_line(mission: MissionInfo) -> str:
    return (
        f"<b>{escape(mission.scenario)}</b>"
        f'<span class="chip {mission.state}">{mission.state.value}</span>'
        f"<small>{escape(mission.id)} · {escape(mission.llm)}</small>"
    )


def _no_mission() -> str:
    return "<b>No mission</b><small>Create one by the API or by falconer run.</small>"


def _report(task: asyncio.Task[None]) -> None:
    if not task.cancelled() and (error := task.exception()) is not None:
        log.error("the console has stopped following", exc_info=error)
