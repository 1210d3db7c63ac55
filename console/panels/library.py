"""What there is to look at: missions, and the recordings in the server's folder."""

from collections.abc import Iterable
from typing import Any

from nicegui import ui

from console.board import Board, Facts
from console.panel import Panel
from console.render import clock, escape
from server.api.errors import ServiceError
from server.api.models import Clock, MissionInfo
from server.api.service import MissionService

Json = dict[str, Any]

MISSIONS_SHOWN = 30
RECORDINGS_SHOWN = 100


class MissionsPanel(Panel):
    """Every mission of this server, to choose which one everybody looks at."""

    styles = ("library.css",)

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the list, the newest first."""
        looked_at = facts.looking.mission
        chosen = "" if looked_at is None else looked_at.id
        return {"missions": missions(facts.service.missions(), chosen)}

    def build(self) -> None:
        """Show the list."""
        with ui.element("section").classes("library"):
            ui.html("<h3>Missions</h3>", sanitize=False)
            self.desk.taps(self.html("missions", "rows missions"), self._tapped)

    async def _tapped(self, said: str) -> None:
        what, _, mission_id = said.partition(":")
        if what != "mission":
            return
        if not self.desk.operates:
            self.desk.tell("You may look; the picture is everybody's, and chosen by an operator.")
            return
        try:
            await self.desk.board.looking.choose(mission_id, self.desk.identity.name)
        except ServiceError as error:
            self.desk.tell(error.message)


class RecordingsPanel(Panel):
    """The recordings in the server's folder, to be opened as replays."""

    styles = ("library.css",)

    @staticmethod
    def stand(board: Board) -> dict[str, str]:
        """Return the list as it was seen last."""
        return {"recordings": recordings(board.workshop.recordings)}

    def build(self) -> None:
        """Show the list, and look at the folder."""
        with ui.element("section").classes("library"):
            with ui.element("div").classes("title"):
                ui.html("<h3>Recordings</h3>", sanitize=False)
                ui.button("Look again", on_click=self.desk.board.workshop.look, color=None).props(
                    "flat no-caps dense"
                ).classes("small")
            self.desk.taps(self.html("recordings", "rows recordings"), self._tapped)
        self.desk.board.workshop.look()

    async def _tapped(self, said: str) -> None:
        what, _, name = said.partition(":")
        if what != "recording" or not self._is_listed(name):
            return
        board = self.desk.board

        async def open_it(_: MissionService, __: str, author: str) -> None:
            self.desk.note("open replay", recording=name)
            mission = await board.workshop.archive().replay(name)
            if board.mission is None or mission.id != board.mission.id:
                await board.looking.choose(mission.id, author)

        await self.desk.act(open_it)

    def _is_listed(self, name: str) -> bool:
        return any(one["name"] == name for one in self.desk.board.workshop.recordings or ())


def missions(known: Iterable[MissionInfo], chosen: str) -> str:
    """Return missions as rows; the one that is looked at is marked."""
    rows = []
    for mission in list(known)[: -MISSIONS_SHOWN - 1 : -1]:
        here = mission.id == chosen
        kind = {Clock.REPLAY: "replay", Clock.LOCKSTEP: "lockstep"}.get(mission.clock, "")
        time_s = "" if mission.time_s is None else clock(mission.time_s)[:-2]
        act = (
            "<em>shown</em>"
            if here
            else f'<button type="button" data-tap="mission:{escape(mission.id)}">Look</button>'
        )
        rows.append(
            f'<div class="row{" here" if here else ""}"><b>{escape(mission.id)}</b>'
            f"<span>{escape(mission.scenario)} <small>{kind}</small></span>"
            f'<span class="chip {mission.state.value}">{mission.state.value}</span>'
            f"<small>{time_s}</small>{act}</div>"
        )
    return "".join(rows) or '<p class="empty">No missions yet.</p>'


def recordings(known: list[Json] | None) -> str:
    """Return recordings as rows; what cannot be read says why."""
    if known is None:
        return '<p class="empty">Looking …</p>'
    rows = []
    for one in known[:RECORDINGS_SHOWN]:
        name = escape(one["name"])
        size = f"{one['size_bytes'] / 1e6:.1f} MB"
        if one["error"] is not None:
            rows.append(
                f'<div class="row broken"><b>{name}</b><span>{escape(one["error"])}</span>'
                f"<small>{size}</small></div>"
            )
            continue
        when = escape(str(one["started_at"])[:16].replace("T", " "))
        cut = "" if one["complete"] else " · cut off, or being written"
        rows.append(
            f'<div class="row" title="{name}"><b>{escape(one["scenario"])}</b>'
            f"<span>{when} <small>{escape(one['llm'])} · {size}{cut}</small></span>"
            f"<small>{clock(one['duration_s'])[:-2]}</small>"
            f'<button type="button" data-tap="recording:{name}">Open</button></div>'
        )
    return "".join(rows) or (
        '<p class="empty">None. With FALCONER_RECORDINGS set to a folder every live mission is'
        " recorded there.</p>"
    )
