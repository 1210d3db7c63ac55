"""The one page at `/`: bar, scene, supervision, team, assignment, weights, events.

NiceGUI builds it and carries panel changes to each browser. Hold, pause and resume go from the
browser straight to REST (static/console.js), so that stopping needs nothing else to work.
"""

import json
from pathlib import Path
from typing import Final

from fastapi import FastAPI
from nicegui import app as nicegui_app
from nicegui import ui
from starlette.staticfiles import StaticFiles

from console import render
from console.board import Board
from console.proxy import add_scene_routes
from console.scene import open_scene
from server.api.errors import ServiceError
from server.api.models import MAX_COMMENT_CHARACTERS
from server.api.service import MissionService

STATIC: Final = Path(__file__).parent / "static"
REFRESH_S: Final = 0.25
AUTHOR: Final = "operator"

HEAD = """
<link rel="stylesheet" href="/console/console.css">
<link rel="icon" href="/console/falcon.svg" type="image/svg+xml">
<script src="/console/theme.js"></script>
<script src="/console/console.js" defer></script>
"""

SCENE = """
<iframe id="scene" src="/scene/" title="The team in three dimensions"></iframe>
<div class="legend" aria-hidden="true">
  <span><i class="sensing"></i>sensing zone</span>
  <span><i class="communication"></i>communication zone</span>
  <span><i class="undiscovered"></i>undiscovered</span>
  <span><i class="ellipse"></i>target, 2σ</span>
</div>
"""

STEERING = """
<button class="plain" data-steer="resume" title="Go on (R)">Resume</button>
<button class="hold" data-steer="hold" title="Stop every vehicle now (Space)">
  Hold all<kbd>Space</kbd></button>
"""


def mount(app: FastAPI, service: MissionService) -> None:
    """Put the console on an application: the page, the scene and their files."""
    board = Board(service, open_scene)
    app.mount("/console", StaticFiles(directory=STATIC), name="console")
    add_scene_routes(app, lambda: board.scene)
    nicegui_app.on_startup(board.start)
    nicegui_app.on_shutdown(board.stop)

    @ui.page("/", title="Falconer")
    def console_page() -> None:
        Page(board).build()

    ui.run_with(
        app,
        title="Falconer",
        tailwind=False,
        show_welcome_message=False,
        reconnect_timeout=10.0,
    )


class Page:
    """One browser's page. It holds nothing of its own but what it last showed."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._panels: dict[str, ui.html] = {}
        self._version = -1
        self._suggested: list[str] = []

    def build(self) -> None:
        """Build the page's elements; they fill themselves from the board."""
        ui.add_head_html(HEAD)
        with ui.element("div").classes("console").props('id="console"'):
            self._bar()
            with ui.element("main"):
                with ui.element("section").classes("stage").props('aria-label="Scene"'):
                    ui.html(SCENE, sanitize=False).classes("scene")
                    self._panel("figures", "figures")
                with ui.element("div").classes("tables"):
                    self._card("Team", "team")
                    self._card("Assignment", "matrix", note="assignment_note")
                    self._card("Weights", "weights", note="weights_note")
            with ui.element("aside"):
                self._supervise()
                self._card("Events", "events")
        ui.html("", sanitize=False).classes("notice").props('id="notice" role="alert"')
        self._refresh()
        ui.timer(REFRESH_S, self._refresh)

    def _bar(self) -> None:
        with ui.element("header").classes("bar"):
            ui.html('<span class="brand">Falconer</span>', sanitize=False)
            self._panel("mission", "mission")
            self._panel("clock", "clock")
            self._panel("lamps", "lamps")
            self._panel("guidance", "ladder")
            ui.html(
                '<button class="plain icon" data-theme-toggle title="Light or dark"'
                ' aria-label="Light or dark">◐</button>',
                sanitize=False,
            )
            ui.html(STEERING, sanitize=False).classes("steering")

    def _supervise(self) -> None:
        with ui.element("section").classes("card supervise"):
            ui.html("<h2>Supervise</h2>", sanitize=False)
            with ui.element("div").classes("write"):
                self._text = (
                    ui.textarea(placeholder="Tell the models what matters, in plain words")
                    .props(
                        f'borderless autogrow maxlength="{MAX_COMMENT_CHARACTERS}"'
                        ' input-class="comment-box" aria-label="Comment"'
                    )
                    .classes("text")
                    .on("keydown.enter.exact.prevent", self._send)
                )
                ui.button("Send", on_click=self._send, color=None).props(
                    "unelevated no-caps"
                ).classes("send")
            self._chips = ui.element("div").classes("chips")
            self._panel("receipts", "scroll receipts")

    def _card(self, title: str, panel: str, note: str | None = None) -> None:
        with ui.element("section").classes(f"card {panel}-card"):
            with ui.element("div").classes("card-head"):
                ui.html(f"<h2>{title}</h2>", sanitize=False)
                if note is not None:
                    self._panel(note, "note")
            self._panel(panel, f"scroll {panel}")

    def _panel(self, name: str, classes: str) -> None:
        panel = ui.html(self._board.panels.get(name, ""), sanitize=False).classes(classes)
        self._panels[name] = panel

    def _refresh(self) -> None:
        """Copy what has changed; NiceGUI sends only that."""
        if self._version == self._board.version:
            return
        self._version = self._board.version
        for name, panel in self._panels.items():
            content = self._board.panels.get(name, "")
            if panel.content != content:
                panel.set_content(content)
        mission = self._board.mission
        name = "" if mission is None else mission.id
        state = "" if mission is None else mission.state.value
        ui.run_javascript(f"falconer.show({json.dumps(name)}, {json.dumps(state)})")
        self._suggest()

    def _suggest(self) -> None:
        """Offer sentences; new ones only when they differ, so that none moves under a finger."""
        wanted = render.suggestions(self._board.snapshot)
        if not self._suggested and wanted:
            self._offer(wanted)

    def _offer(self, sentences: list[str]) -> None:
        self._suggested = sentences
        self._chips.clear()
        with self._chips:
            for sentence in sentences:
                ui.button(sentence, on_click=lambda _, s=sentence: self._take(s), color=None).props(
                    "flat no-caps dense"
                ).classes("chip-button")

    def _take(self, sentence: str) -> None:
        self._text.set_value(sentence)
        self._text.run_method("focus")

    async def _send(self) -> None:
        """Give the comment to the mission; on refusal it stays in the box."""
        text = (self._text.value or "").strip()
        mission = self._board.mission
        if not text:
            return
        if mission is None:
            _tell("There is no mission to comment on.")
            return
        try:
            await self._board.service.comment(mission.id, text, AUTHOR)
        except ServiceError as error:
            _tell(error.message)
            return
        self._text.set_value("")
        self._offer(render.suggestions(self._board.snapshot))


def _tell(words: str) -> None:
    """Show a notice in this browser."""
    ui.run_javascript(f"falconer.tell({json.dumps(words)})")
