"""The timeline below the scene: the mission's course, and the way back to any of its instants."""

import json
import math
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from console.board import Board, Facts
from console.course import Cursor, added, cursor_of, whole
from console.panel import Panel
from console.render import clock, escape
from server.api.errors import ServiceError
from server.api.models import Clock, MissionInfo
from server.api.service import MissionService

Json = dict[str, Any]

SPEEDS = (1.0, 2.0, 5.0, 20.0)

FRAME = """
<div class="plane" role="slider" tabindex="0" aria-label="Mission time" aria-valuemin="0"
  aria-valuemax="0" aria-valuenow="0"><div class="unkept"></div><div class="cursor"></div></div>
"""
WINDOWS = """
<span class="windows" role="group" aria-label="Stretch of time shown">
<button type="button" data-window="120">2 min</button>
<button type="button" data-window="600">10 min</button>
<button type="button" data-window="all">All</button></span>
"""


class LookPanel(Panel):
    """The banner on the scene while something else than the present is looked at."""

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the banner, empty while the present is looked at."""
        return {"look": banner(facts)}

    def build(self) -> None:
        """Show it; its button goes back."""
        self.desk.taps(self.html("look", "look"), self._tapped)

    def _tapped(self, said: str) -> None:
        if said == "look:live":
            go_live(self)


class TimelinePanel(Panel):
    """The course of the mission that is looked at, with its scrubber."""

    styles = ("timeline.css",)
    scripts = ("timeline.js",)

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the controls above the lanes. The lanes are sent piece by piece."""
        looking = facts.looking
        now = cursor_of(looking.course_of, looking.course)
        # The last piece stands nowhere: it makes every page look for what is new.
        return {
            "timeline": controls(facts),
            "timeline_what": what(facts),
            "timeline_now": f"{now} {looking.at_s}",
        }

    def build(self) -> None:
        """Show controls, lanes and scrubber."""
        with ui.element("section").classes("timeline").props('id="timeline" aria-label="Timeline"'):
            self.desk.taps(self.html("timeline", "controls"), self._tapped)
            with ui.element("div").classes("lanes"):
                self._lanes = ui.html("", sanitize=False).classes("drawn")
                ui.html(FRAME, sanitize=False)
            with ui.element("div").classes("foot"):
                self.html("timeline_what", "what")
                ui.html("", sanitize=False).classes("axis")
                ui.html(WINDOWS, sanitize=False).classes("choose")
        ui.on("falconer-seek", self._seek)
        ui.on("falconer-live", lambda: go_live(self))
        self._sent: Cursor | None = None
        self._state: Json = {}
        self.follow()

    def refresh(self) -> None:
        """Send what is new."""
        super().refresh()
        self.follow()

    def follow(self) -> None:
        """Send new points, or everything where what was sent is void; and where we look."""
        looking = self.desk.board.looking
        now = cursor_of(looking.course_of, looking.course)
        sent, self._sent = self._sent, now
        if sent is None or (sent.mission, sent.version) != (now.mission, now.version):
            self._lanes.set_content(whole(looking.course))
            self._state = {}
        elif sent != now:
            news = json.dumps(added(looking.course, sent))
            ui.run_javascript(f"falconer.timeline.add({news})")
        state = scrubber(self.desk.board)
        if state != self._state:
            self._state = state
            ui.run_javascript(f"falconer.timeline.show({json.dumps(state)})")

    async def _seek(self, event: GenericEventArguments) -> None:
        """Look at the instant that the browser names."""
        at_s = event.args
        if not isinstance(at_s, int | float) or not math.isfinite(at_s):
            return
        if not self.desk.operates:
            self.desk.tell("You may look; the picture is everybody's, and moved by an operator.")
            return
        try:
            await self.desk.board.looking.back(float(at_s), self.desk.identity.name)
        except ServiceError as error:
            self._state = {}  # the cursor must go back to where it was
            self.desk.tell(error.message)

    async def _tapped(self, said: str) -> None:
        looking = self.desk.board.looking
        mission = looking.mission
        if said == "look:live":
            go_live(self)
            return
        if mission is None or mission.clock is not Clock.REPLAY:
            return
        picture = looking.picture or self.desk.board.snapshot or {}

        async def steer(service: MissionService, _: str, author: str) -> None:
            match said.split(":"):
                case ["replay", "play"]:
                    await service.resume(mission.id, author)
                case ["replay", "pause"]:
                    await service.pause(mission.id, author)
                case ["replay", "speed", speed] if speed in {f"{s:g}" for s in SPEEDS}:
                    await service.seek(mission.id, picture.get("time_s") or 0.0, float(speed))
                case ["replay", "close"]:
                    self.desk.note("close replay", mission=mission.id)
                    looking.live()
                    await service.stop(mission.id, author)
                    await service.delete(mission.id, author)

        await self.desk.act(steer)


def go_live(panel: Panel) -> None:
    """Let everybody look at the steered mission's present again."""
    if panel.desk.operates:
        panel.desk.board.looking.live()
    else:
        panel.desk.tell("You may look; the picture is everybody's, and moved by an operator.")


def scrubber(board: Board) -> Json:
    """Return where the cursor stands, as the browser's script wants it."""
    looking = board.looking
    picture = board.picture
    time_s = 0.0 if picture is None else picture["time_s"] or 0.0
    until_s = looking.course.until_s
    if looking.replays:
        return {"until": until_s, "at": round(time_s, 1), "kept": 0.0, "away": looking.away,
                "replay": True}  # fmt: skip
    if looking.at_s is None:
        until_s = max(until_s, math.floor(time_s))
    return {
        "until": until_s,
        "at": looking.at_s,
        "kept": None if looking.mission is None else _kept_from_s(board, looking.mission.id),
        "away": looking.away,
        "replay": False,
    }


def _kept_from_s(board: Board, mission_id: str) -> float | None:
    """Return from when on pictures are at hand; None also for a mission removed a moment ago."""
    try:
        return board.service.hindsight.kept_from_s(mission_id)
    except ServiceError:
        return None


def banner(facts: Facts) -> str:
    """Return in words that something else than the present is looked at, and how to go back."""
    looking = facts.looking
    if not looking.away or looking.mission is None:
        return ""
    shown, live = looking.mission, facts.mission
    when = "" if looking.at_s is None else f" at {clock(looking.at_s)[:-2]}"
    which = "" if shown.id == live.id else f" {_named(shown)}"
    joint = " of" if when and which else "" if when else " at"
    head = f"Looking{when}{joint}{which}"
    time_s = None if facts.snapshot is None else facts.snapshot["time_s"]
    goes_on = (
        f"live goes on: {clock(time_s)[:-2]}"
        if live.state.value == "running"
        else (f"{escape(live.id)} is {live.state.value}")
    )
    by = f" · {escape(looking.by)}" if looking.by else ""
    return (
        f'<div class="look-banner" role="status"><span>{head}</span>'
        f"<small>{goes_on}{by}</small>"
        '<button type="button" data-tap="look:live">Back to live<kbd>L</kbd></button></div>'
    )


def controls(facts: Facts) -> str:
    """Return how a replay is played; empty where none is looked at."""
    if not facts.looking.replays:
        return ""
    picture = facts.picture or {}
    speed = (picture.get("replay") or {}).get("speed", 1.0)
    playing = picture.get("state") == "running"
    act, word = ("pause", "Pause") if playing else ("play", "Play")
    speeds = "".join(
        f'<button type="button" data-tap="replay:speed:{s:g}"'
        f' aria-pressed="{str(s == speed).lower()}">{s:g}×</button>'
        for s in SPEEDS
    )
    return (
        f'<button type="button" data-tap="replay:{act}">{word}</button>{speeds}'
        '<button type="button" data-tap="replay:close">Close</button>'
    )


def what(facts: Facts) -> str:
    """Return which mission's course is drawn."""
    mission = facts.looking.mission
    return "" if mission is None else _named(mission)


def _named(mission: MissionInfo) -> str:
    kind = "replay of " if mission.clock is Clock.REPLAY else ""
    state = "" if mission.clock is Clock.REPLAY else f", {mission.state.value}"
    return f"{kind}{escape(mission.scenario)} ({escape(mission.id)}{state})"
