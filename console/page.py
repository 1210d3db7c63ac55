"""The one page at `/`: its frame, and where each panel is mounted.

NiceGUI builds it and carries changes to each browser. Hold, pause and resume go from the browser
straight to REST (static/console.js), so that stopping needs nothing else to work.
"""

import json
from pathlib import Path
from typing import Final

import structlog
from fastapi import FastAPI
from nicegui import app as nicegui_app
from nicegui import ui
from starlette.requests import Request
from starlette.staticfiles import StaticFiles

from console.board import Board
from console.panel import Desk, Panel, Tab, Tabs
from console.panels.alarms import AlarmLampPanel, AlarmsPanel
from console.panels.approvals import ApprovalsPanel
from console.panels.assignment import AssignmentPanel
from console.panels.bar import NO_MISSION, GuidancePanel, LampsPanel, MissionPanel
from console.panels.decisions import DecisionsPanel
from console.panels.events import EventsPanel
from console.panels.experiments import ExperimentsPanel
from console.panels.figures import AbsencePanel, FiguresPanel
from console.panels.library import MissionsPanel, RecordingsPanel
from console.panels.supervise import SupervisePanel
from console.panels.team import TeamPanel
from console.panels.timeline import LookPanel, TimelinePanel
from console.panels.view import ViewPanel
from console.panels.weights import WeightsPanel
from console.panels.whatif import WhatIfPanel
from console.panels.zones import ZonesPanel
from console.proxy import add_scene_routes
from console.scene import open_scene
from console.workshop import Workshop
from server.api.identity import identity_of
from server.api.service import MissionService

log = structlog.get_logger(__name__)

# ---------------------------------------------------------------- where panels are mounted
# An area without panels is not built.

BAR: tuple[type[Panel], ...] = (MissionPanel, AlarmLampPanel, LampsPanel, GuidancePanel)
STAGE: tuple[type[Panel], ...] = (FiguresPanel, AbsencePanel, ViewPanel, LookPanel)
STRIP: tuple[type[Panel], ...] = (TimelinePanel,)
DECK: tuple[Tabs, ...] = (
    Tabs("team", (Tab("Team", (TeamPanel,)),)),
    Tabs("assignment", (Tab("Assignment", (AssignmentPanel,)),)),
    Tabs("limits", (Tab("Weights", (WeightsPanel,)), Tab("Zones", (ZonesPanel,)))),
)
ASIDE: Tabs = Tabs(
    "aside",
    (
        Tab("Supervise", (ApprovalsPanel, SupervisePanel)),
        Tab("Decisions", (DecisionsPanel,)),
        Tab("Alarms", (AlarmsPanel,)),
        Tab("Events", (EventsPanel,)),
        Tab("Library", (MissionsPanel, RecordingsPanel, WhatIfPanel, ExperimentsPanel)),
    ),
)
PANELS: Final[tuple[type[Panel], ...]] = (
    *BAR,
    *STAGE,
    *STRIP,
    *(panel for tabs in (*DECK, ASIDE) for panel in tabs.panels()),
)

STATIC: Final = Path(__file__).parent / "static"
REFRESH_S: Final = 0.25
NOTICED_S: Final = 10.0
"""A connection that is gone is noticed by either side within so long, and somewhat more."""

KEPT_S: Final = 60.0
"""A page whose browser is gone is kept for so long: what was typed there outlasts a short outage
of the network, or a machine that is busy."""

SCENE = """
<iframe id="scene" src="/scene/{view}/" title="The team in three dimensions"></iframe>
<div class="legend" aria-hidden="true">
  <span><i class="sensing"></i>sensing zone</span>
  <span><i class="communication"></i>communication zone</span>
  <span><i class="cloud"></i>inferred</span>
  <span><i class="undiscovered"></i>undiscovered</span>
  <span><i class="ellipse"></i>target, 2σ</span>
  <span><i class="waypoint"></i>way-point</span>
</div>
"""

THEME = (
    '<button type="button" class="plain icon" data-theme-toggle title="Light or dark"'
    ' aria-label="Light or dark">◐</button>'
)

STEERING = """
<button type="button" class="plain" data-steer="resume" title="Go on (R)">Resume</button>
<button type="button" class="hold" data-steer="hold" title="Stop every vehicle now (Space)">
  Hold all<kbd>Space</kbd></button>
"""


def mount(app: FastAPI, service: MissionService) -> None:
    """Put the console on an application: the page, the scene and their files."""
    board = Board(
        service,
        open_scene,
        Workshop(lambda: app.state.archive, lambda: app.state.laboratory),
        draws=[panel.draw for panel in PANELS],
        stands=[panel.stand for panel in PANELS],
        nothing={"mission": NO_MISSION},
    )
    app.mount("/console", StaticFiles(directory=STATIC), name="console")
    add_scene_routes(app, lambda: board.scene, board.viewers)
    nicegui_app.on_startup(board.start)
    nicegui_app.on_shutdown(board.stop)

    @ui.page("/", title="Falconer", reconnect_timeout=KEPT_S)
    def console_page(request: Request) -> None:
        identity = identity_of(request)
        page = Page(Desk(board, identity, board.viewers.enter(identity)))
        ui.context.client.on_delete(page.close)
        page.build()

    ui.run_with(
        app,
        title="Falconer",
        tailwind=False,
        show_welcome_message=False,
        reconnect_timeout=NOTICED_S,
    )


def head() -> str:
    """Return what the page's head links: our own files and those of the panels."""
    styles = dict.fromkeys(["console.css", *(name for p in PANELS for name in p.styles)])
    scripts = dict.fromkeys(["console.js", *(name for p in PANELS for name in p.scripts)])
    lines = [f'<link rel="stylesheet" href="/console/{name}">' for name in styles]
    lines.append('<link rel="icon" href="/console/falcon.svg" type="image/svg+xml">')
    lines.append('<script src="/console/theme.js"></script>')
    lines += [f'<script src="/console/{name}" defer></script>' for name in scripts]
    return "\n".join(lines)


class Page:
    """One browser's page. It holds nothing of its own but what it last showed."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._panels: list[Panel] = []
        self._version = -1

    def build(self) -> None:
        """Build the page's elements; they fill themselves from the board."""
        ui.add_head_html(head())
        frame = ui.element("div").classes("console").props("id=console")
        frame.props["data-mission"], frame.props["data-state"] = self._shown()
        frame.props["data-role"] = self._desk.identity.role.value
        with frame:
            with ui.element("header").classes("bar"):
                ui.html('<span class="brand">Falconer</span>', sanitize=False)
                self._mount(BAR)
                ui.html(THEME, sanitize=False)
                ui.html(STEERING, sanitize=False).classes("steering")
            with ui.element("main"):
                with ui.element("section").classes("stage").props('aria-label="Scene"'):
                    ui.html(SCENE.format(view=self._desk.view), sanitize=False).classes("scene")
                    self._mount(STAGE)
                if STRIP:
                    with ui.element("section").classes("strip card"):
                        self._mount(STRIP)
                with ui.element("div").classes("deck"):
                    for tabs in DECK:
                        self._panels += tabs.build(self._desk)
            with ui.element("aside"):
                self._panels += ASIDE.build(self._desk)
        ui.html("", sanitize=False).classes("notice").props('id="notice" role="alert"')
        self._refresh()
        ui.timer(REFRESH_S, self._refresh)

    def close(self) -> None:
        """Let go of what the page held: the browser is gone."""
        for panel in self._panels:
            panel.close()
        self._desk.board.viewers.leave(self._desk.view)

    def _mount(self, kinds: tuple[type[Panel], ...]) -> None:
        for kind in kinds:
            panel = kind(self._desk)
            panel.build()
            self._panels.append(panel)

    def _refresh(self) -> None:
        """Let every panel copy what has changed; NiceGUI sends only that."""
        board = self._desk.board
        if self._version == board.version:
            return
        self._version = board.version
        for panel in self._panels:
            try:
                panel.refresh()
            except Exception:  # a fault in one panel must not take the others from sight
                log.exception("a panel cannot be refreshed", panel=type(panel).__qualname__)
        name, state = self._shown()
        ui.run_javascript(f"falconer.show({json.dumps(name)}, {json.dumps(state)})")

    def _shown(self) -> tuple[str, str]:
        """Return the id and state of the mission shown, for what the browser does on its own."""
        mission = self._desk.board.mission
        return ("", "") if mission is None else (mission.id, mission.state.value)
