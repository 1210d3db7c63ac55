"""What the console shows, kept once for all browsers: the server's state, not the page's.

One task follows the mission that matters (the live one, else the newest) and draws the scene;
every page only copies from here what has changed. What is looked at may be something else
(`console.looking`): what people act on never is.
"""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import structlog

from console.ledger import Ledger
from console.looking import Looking
from console.scene import Scene
from console.viewers import Viewers
from console.workshop import Workshop
from server.api.errors import ServiceError
from server.api.models import MissionInfo
from server.api.service import MissionService
from server.api.silence import silence_s

log = structlog.get_logger(__name__)

SCENE, FOLLOWING = "scene", "following"
"""Names among what is broken, beside those of panels."""

SCENE_FAULT = "The scene cannot be drawn: what it shows is old. The panels are not."

LOOK_S = 0.3
"""How often to look for another mission."""

PANEL_S = 0.25
"""How often panels change at most."""

CARDS_READ = 1000
EVENTS_READ = 5000
"""What is read of a mission that has flown for a while, to know who asked for what."""

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Facts:
    """What the panels are drawn from."""

    mission: MissionInfo
    snapshot: Json | None
    """The newest message of that mission: what is acted on."""

    picture: Json | None
    """What is looked at: the same, or an instant that is gone, or another mission."""

    looking: Looking
    workshop: Workshop
    service: MissionService
    """To read from."""

    ledger: Ledger = field(default_factory=Ledger)
    """Who asked for what stands now."""

    silent_s: float = 0.0
    """For how long a mission has been silent that should speak at every tick; 0 while it speaks.

    What it said last must then not pass for how things are."""

    scene_fault: str = ""
    """Why the scene is not what it should show, in a sentence; "" while it is."""


Draw = Callable[[Facts], dict[str, str]]
"""Draws pieces of HTML by name, for all browsers. A few milliseconds at most."""

Stand = Callable[["Board"], dict[str, str]]
"""Draws pieces that are there without a mission, too."""


@dataclass(slots=True)
class Board:
    """The newest picture of one mission, with its panels rendered once."""

    service: MissionService
    open_scene: Callable[[], Scene]
    workshop: Workshop
    draws: Sequence[Draw] = ()
    stands: Sequence[Stand] = ()
    nothing: Mapping[str, str] = field(default_factory=dict)
    """What is shown while there is no mission."""

    scene: Scene | None = None
    viewers: Viewers = field(default_factory=Viewers)
    """Which view of the scene is whose."""

    ledger: Ledger = field(default_factory=Ledger)
    """Who asked for what in the mission shown."""

    mission: MissionInfo | None = None
    snapshot: Json | None = None
    panels: dict[str, str] = field(default_factory=dict)
    """What was drawn last: HTML by name."""

    version: int = 0
    """Counts changes of `panels`."""

    looking: Looking = field(init=False)
    _shown: bool = False
    """Whether somebody has seen the picture that was to be shown last."""

    _task: asyncio.Task[None] | None = None
    _rendered_s: float = 0.0
    _broken: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.looking = Looking(self.service, self._show, lambda: self.snapshot)

    @property
    def picture(self) -> Json | None:
        """What is looked at."""
        return self.looking.picture if self.looking.away else self.snapshot

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
        self.looking.close()
        await self.workshop.close()
        if self.scene is not None:
            scene, self.scene = self.scene, None
            await asyncio.to_thread(scene.close)

    async def _follow(self) -> None:
        """Follow what matters for ever: whatever is wrong with one picture, another comes."""
        while True:
            try:
                mission = self._choose()
                if mission is not None:
                    await self._watch(mission)
                    continue
                self.looking.steer(None)
                self._show_nothing()
            except ServiceError as error:  # it was removed a moment ago
                log.info("a mission can no longer be followed", why=error.message)
            except Exception:
                if self._breaks(FOLLOWING):
                    log.exception("the console has stumbled, and goes on")
            await asyncio.sleep(LOOK_S)

    def _choose(self) -> MissionInfo | None:
        """Return the live mission, else the newest one."""
        missions = self.service.missions()
        return self.service.live_mission() or (missions[-1] if missions else None)

    async def _watch(self, mission: MissionInfo) -> None:
        """Show one mission until another one matters."""
        if self.mission is None or self.mission.id != mission.id:
            self.snapshot, self.ledger = None, Ledger()
        self.looking.steer(mission)
        await self._recall(mission)
        async with self.service.subscribe(mission.id) as stream:
            self.ledger.take(
                self.service.decisions(mission.id, 0, CARDS_READ),
                self.service.recent_events(mission.id, EVENTS_READ),
            )
            while (chosen := self._choose()) is not None and chosen.id == mission.id:
                self.mission = chosen
                self.looking.steer(chosen)
                self._show_again()
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
                else:
                    self.ledger.note_event(message)
                self._broken.discard(FOLLOWING)
                self._render()

    async def _recall(self, mission: MissionInfo) -> None:
        """Have the last picture of a mission that says nothing any more."""
        try:
            last = await self.service.hindsight.last(mission.id)
        except ServiceError as error:
            log.info("no last picture", mission=mission.id, why=error.message)
            return
        if last is not None:
            self.mission = mission
            self._take(last)

    def _take(self, snapshot: Json) -> None:
        self.snapshot = snapshot
        if not self.looking.away:
            self._show(snapshot)

    def _show(self, picture: Json) -> None:
        """Draw a picture in the scene, if anybody watches it."""
        if self.scene is not None:
            self._shown = self.scene.watched
            self._paint(self.scene, picture)

    def _show_again(self) -> None:
        """Draw the picture for somebody who came after it."""
        if not self._shown and self.scene is not None and self.picture is not None:
            self._shown = self.scene.watched
            self._paint(self.scene, self.picture)

    def _paint(self, scene: Scene, picture: Json) -> None:
        """Let the scene show a picture; a fault in it must not take the panels from sight."""
        try:
            scene.note(picture)
            if self._shown:
                scene.draw(picture)
        except Exception:
            if self._breaks(SCENE):
                log.exception("the scene cannot be drawn")
        else:
            self._broken.discard(SCENE)

    def _show_nothing(self) -> None:
        self.mission, self.snapshot = None, None
        self._put(dict(self.nothing) | self._standing())

    def _standing(self) -> dict[str, str]:
        pieces: dict[str, str] = {}
        for stand in self.stands:
            pieces |= self._drawn(stand.__qualname__, partial(stand, self))
        return pieces

    def _render(self) -> None:
        """Draw the panels again, not more often than they can be read."""
        now_s = asyncio.get_running_loop().time()
        if self.mission is None or now_s - self._rendered_s < PANEL_S:
            return
        self._rendered_s = now_s
        facts = Facts(
            mission=self.mission,
            snapshot=self.snapshot,
            picture=self.picture,
            looking=self.looking,
            workshop=self.workshop,
            service=self.service,
            ledger=self.ledger,
            silent_s=silence_s(self.mission, self.snapshot),
            scene_fault=SCENE_FAULT if SCENE in self._broken else "",
        )
        panels = self._standing()
        for draw in self.draws:
            panels |= self._drawn(draw.__qualname__, partial(draw, facts))
        self._put(panels)

    def _drawn(self, name: str, draw: Callable[[], dict[str, str]]) -> dict[str, str]:
        """Return what one panel draws; a fault in it must not take the others from sight."""
        try:
            pieces = draw()
        except Exception:
            if self._breaks(name):
                log.exception("a panel cannot be drawn", panel=name)
            return {}
        self._broken.discard(name)
        return pieces

    def _breaks(self, name: str) -> bool:
        """Take note that something is broken; tell whether that is new, and worth a log entry."""
        new = name not in self._broken
        self._broken.add(name)
        return new

    def _put(self, panels: dict[str, str]) -> None:
        if panels != self.panels:
            self.panels = panels
            self.version += 1


def _report(task: asyncio.Task[None]) -> None:
    if not task.cancelled() and (error := task.exception()) is not None:
        log.error("the console has stopped following", exc_info=error)
