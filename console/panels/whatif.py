"""What if: the mission flown on from the instant that is looked at, under other guidance."""

from dataclasses import asdict
from typing import Any

from nicegui import ui
from pydantic import TypeAdapter

from console.board import Facts
from console.panel import Panel
from console.panels.parts import choice
from console.render import clock, escape
from console.workshop import Change, WhatIf
from server.api.identity import Role
from server.api.models import CommentText
from server.api.service import MissionService
from server.mission.setup import GateMode

FIGURES = (
    ("accumulated_trace", "Accumulated trace"),
    ("sensing_attacks", "Sensing hits"),
    ("communication_attacks", "Link hits"),
)
AS_FLOWN = "as flown"
_TEXT: TypeAdapter[str] = TypeAdapter(CommentText)


class WhatIfPanel(Panel):
    """Another comment, model or gate from here on, and what would have come of it."""

    styles = ("library.css",)

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return from where it would be flown on, and what was asked before."""
        return {"whatif_from": origin(facts), "whatif": stories(facts.workshop.forks)}

    def build(self) -> None:
        """Show the form for those who may ask, and the outcomes for all."""
        self._gate = self._llm = ""
        with ui.element("section").classes("library whatif"):
            ui.html("<h3>What if</h3>", sanitize=False)
            self.html("whatif_from", "from")
            if self.desk.may(Role.ADMIN):
                self._form()
            self.html("whatif", "rows stories")

    def _form(self) -> None:
        profiles = [profile.name for profile in self.desk.board.service.profiles()]
        with ui.element("div").classes("form"):
            self._text = (
                ui.input(placeholder="Another comment (may stay empty)")
                .props('borderless dense aria-label="Comment of the fork"')
                .classes("field wide")
            )
            choice("Model", profiles, self._choose_llm)
            choice("Gate", [AS_FLOWN, *(mode.value for mode in GateMode)], self._choose_gate)
            ui.button("Fly on from there", on_click=self._ask, color=None).props(
                "unelevated no-caps"
            ).classes("go")

    def _choose_llm(self, llm: str) -> None:
        self._llm = llm

    def _choose_gate(self, gate: str) -> None:
        self._gate = gate

    async def _ask(self) -> None:
        board = self.desk.board
        looking = board.looking
        mission = looking.mission
        text = (self._text.value or "").strip()
        if mission is None:
            self.desk.tell("There is no mission.")
            return
        at_s = _instant(board.looking.at_s, board.picture)

        async def begin(service: MissionService, _: str, author: str) -> None:
            service.recording(mission.id)  # says at once when there is none
            comment = _TEXT.validate_python(text) if text else ""
            gate = None if self._gate == AS_FLOWN else GateMode(self._gate)
            change = Change(mission.id, at_s, self._llm, gate, comment)
            self.desk.note("fork", **asdict(change))
            board.workshop.fork(change, author)
            self._text.set_value("")

        await self.desk.act(begin, Role.ADMIN)


def origin(facts: Facts) -> str:
    """Return from which instant of which mission it would be flown on."""
    mission = facts.looking.mission
    if mission is None:
        return '<p class="empty">There is no mission to fly on.</p>'
    at_s = _instant(facts.looking.at_s, facts.picture)
    return (
        f"<p>From <b>{clock(at_s)[:-2]}</b> of {escape(mission.scenario)} ({escape(mission.id)}),"
        " in lockstep, to the end of its recording. The timeline chooses another instant.</p>"
    )


def stories(forks: list[WhatIf]) -> str:
    """Return what was asked, the newest first, with both stories' figures side by side."""
    return "".join(_story(one) for one in reversed(forks))


def _story(one: WhatIf) -> str:
    change = one.change
    gate = AS_FLOWN if change.gate is None else change.gate.value
    said = f"<q>{escape(change.comment)}</q> " if change.comment else ""
    head = (
        f"<header><b>{escape(change.mission)} from {clock(change.at_s)[:-2]}</b> {said}"
        f"<small>model {escape(change.llm)}, gate {gate} · {escape(one.by)}</small></header>"
    )
    if one.error:
        body = f'<p class="wrong">{escape(one.error)}</p>'
    elif one.story is None:
        body = '<p class="empty">Being flown …</p>'
    else:
        body = _table(one.story)
    return f'<article class="story" data-fork="{one.number}">{head}{body}</article>'


def _table(story: dict[str, Any]) -> str:
    rows = []
    for key, title in FIGURES:
        recorded, forked = story["recorded"].get(key), story["forked"].get(key)
        tone = ""
        if recorded is not None and forked is not None and forked != recorded:
            tone = " better" if forked < recorded else " worse"
        rows.append(
            f'<tr><th scope="row">{title}</th><td class="num">{_figure(recorded)}</td>'
            f'<td class="num{tone}">{_figure(forked)}</td></tr>'
        )
    return (
        '<table><thead><tr><td></td><th scope="col" class="num">flown</th>'
        '<th scope="col" class="num">what if</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
        f"<small>{clock(story['at_s'])[:-2]} to {clock(story['until_s'])[:-2]}</small>"
    )


def _figure(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"


def _instant(at_s: float | None, picture: dict[str, Any] | None) -> float:
    """Return the instant that is looked at."""
    if at_s is not None:
        return at_s
    return 0.0 if picture is None else max(0.0, picture["time_s"] or 0.0)
