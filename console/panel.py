"""What a panel of the page is: it draws itself once for all browsers, and acts for one.

A panel is drawn from `console.board.Facts` into pieces of HTML that all browsers share; in each
browser it builds its own elements, copies the pieces that have changed, and acts on the service
in the name of whoever looks at it.
"""

import json
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, TypeVar

import structlog
from nicegui import ui
from nicegui.element import Element
from nicegui.events import GenericEventArguments
from pydantic import ValidationError

from console.board import Board, Facts
from console.viewers import NOBODY
from server.api.errors import ServiceError
from server.api.identity import Identity, Role
from server.api.service import MissionService

log = structlog.get_logger(__name__)

Answer = TypeVar("Answer")

MAX_TAP: Final = 200
"""Characters of what a browser may say was tapped."""

_TAPPED: Final = """(event) => {
  const found = event.target.closest("[data-tap]");
  if (found && found.getAttribute("aria-disabled") !== "true") emit(found.dataset.tap);
}"""


@dataclass(frozen=True, slots=True)
class Desk:
    """One browser: what it is shown, who sits before it, how they are told and how they act."""

    board: Board
    identity: Identity
    view: str = NOBODY
    """The name under which this page shows the scene (`console.viewers`)."""

    def may(self, role: Role) -> bool:
        """Tell whether whoever sits here may do what a role may."""
        return self.identity.role.covers(role)

    @property
    def operates(self) -> bool:
        """Whether whoever sits here may steer."""
        return self.may(Role.OPERATOR)

    def at_present(self) -> bool:
        """Tell whether the present is looked at; say here that nothing else can be acted on."""
        if self.board.looking.away:
            self.tell("This picture is not the present: go back to live (L) to act on it.")
        return not self.board.looking.away

    def note(self, what: str, **asked: Any) -> None:
        """Write into the journal what was asked here that no other entry tells the author of."""
        body = {"console": what, "asked": asked}
        self.board.service.chronicle.request(self.identity.name, body)

    def tell(self, words: str) -> None:
        """Show a notice in this browser."""
        ui.run_javascript(f"falconer.tell({json.dumps(words)})")

    async def act(
        self,
        do: Callable[[MissionService, str, str], Awaitable[Answer]],
        role: Role = Role.OPERATOR,
    ) -> Answer | None:
        """Do something with the mission shown, in this person's name.

        `do` gets the service, the mission's id and the author. What is refused, by role, by
        the service or as a value, is told here in words, and so is that it failed; then the
        answer is None.
        """
        mission = self.board.mission
        if not self.may(role):
            self.tell(f"You may look; this needs {_A[role]}.")
            return None
        if mission is None:
            self.tell("There is no mission.")
            return None
        try:
            return await do(self.board.service, mission.id, self.identity.name)
        except ServiceError as error:
            self.tell(error.message)
        except ValidationError as error:
            self.tell(_words(error))
        except Exception:  # whoever pressed something must not believe that it was done
            log.exception("what was asked in the console has failed", author=self.identity.name)
            self.tell("That failed, and may not have been done: look before you ask again.")
        return None

    def taps(self, element: Element, handle: Callable[[str], Awaitable[None] | None]) -> None:
        """Call `handle` with the data-tap of whatever is clicked inside an element.

        What comes is a browser's word: check it as any request is checked.
        """

        def tapped(event: GenericEventArguments) -> Awaitable[None] | None:
            said = event.args
            return handle(said) if isinstance(said, str) and len(said) <= MAX_TAP else None

        element.on("click", tapped, js_handler=_TAPPED)


class Panel:
    """One panel in one browser. It holds nothing but what it last showed."""

    note: ClassVar[str] = ""
    """The drawn piece that stands beside its title."""

    badge: ClassVar[str] = ""
    """The drawn piece that stands on its tab."""

    styles: ClassVar[tuple[str, ...]] = ()
    """Its files in `static/`."""

    scripts: ClassVar[tuple[str, ...]] = ()

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return pieces of HTML by name, for all browsers; sync, within milliseconds.

        Every word from outside goes through `render.escape`.
        """
        return {}

    @staticmethod
    def stand(board: Board) -> dict[str, str]:
        """Return pieces that are there without a mission, too; else as `draw`."""
        return {}

    def __init__(self, desk: Desk) -> None:
        self.desk = desk
        self._pieces: dict[str, ui.html] = {}

    def build(self) -> None:
        """Make the panel's elements in the container around, once."""

    def refresh(self) -> None:
        """Show what has changed on the board; NiceGUI sends only that."""
        drawn = self.desk.board.panels
        for name, piece in self._pieces.items():
            content = drawn.get(name, "")
            if piece.content != content:
                piece.set_content(content)

    def close(self) -> None:
        """Let go of what it holds outside the page; the browser is gone."""

    def html(self, name: str, classes: str) -> ui.html:
        """Show a drawn piece here, always as it was drawn last."""
        content = self.desk.board.panels.get(name, "")
        piece = ui.html(content, sanitize=False).classes(classes)
        self._pieces[name] = piece
        return piece


@dataclass(frozen=True, slots=True)
class Tab:
    """Some panels under one title."""

    title: str
    panels: tuple[type[Panel], ...]


@dataclass(frozen=True, slots=True)
class Tabs:
    """A card with one or more tabs; which one is open is each browser's own."""

    name: str
    """Its CSS class, and the key under which the browser remembers the open tab."""

    tabs: tuple[Tab, ...]

    def panels(self) -> tuple[type[Panel], ...]:
        """Return the panels of all tabs."""
        return tuple(panel for tab in self.tabs for panel in tab.panels)

    def build(self, desk: Desk) -> list[Panel]:
        """Make the card and its panels."""
        made = [[panel(desk) for panel in tab.panels] for tab in self.tabs]
        with (
            ui.element("section").classes(f"card {self.name}-card").props(f"data-tabs={self.name}")
        ):
            with ui.element("div").classes("card-head"):
                self._titles(made)
                for number, panels in enumerate(made):
                    for panel in panels:
                        if panel.note:
                            note = panel.html(panel.note, "note")
                            note.props(f"data-tab-of={number}{' hidden' if number else ''}")
            for number, panels in enumerate(made):
                page = ui.element("div").classes("tab-page")
                if len(self.tabs) > 1:
                    page.props(
                        f"role=tabpanel id={self.name}-page-{number} data-tab-of={number}"
                        f" aria-labelledby={self.name}-tab-{number}{' hidden' if number else ''}"
                    )
                with page:
                    for panel in panels:
                        panel.build()
        return [panel for panels in made for panel in panels]

    def _titles(self, made: Sequence[Sequence[Panel]]) -> None:
        if len(self.tabs) == 1:
            ui.html(f"<h2>{self.tabs[0].title}</h2>", sanitize=False)
            return
        with ui.element("div").classes("tab-list").props("role=tablist"):
            for number, (tab, panels) in enumerate(zip(self.tabs, made, strict=True)):
                button = ui.element("button").props(
                    f"type=button role=tab id={self.name}-tab-{number} data-tab={number}"
                    f" aria-controls={self.name}-page-{number}"
                    f" aria-selected={'false' if number else 'true'}"
                    f" tabindex={-1 if number else 0}"
                )
                with button:
                    ui.html(tab.title, sanitize=False, tag="span")
                    for panel in panels:
                        if panel.badge:
                            panel.html(panel.badge, "badge")


_A: Final = {
    Role.VIEWER: "a viewer",
    Role.OPERATOR: "an operator",
    Role.ADMIN: "an administrator",
}


def _words(error: ValidationError) -> str:
    """Return what is wrong with a value: the field, and what is allowed."""
    parts: list[str] = []
    for fault in error.errors(include_url=False, include_context=False, include_input=False):
        where: Any = ".".join(str(part) for part in fault["loc"])
        parts.append(f"{where}: {fault['msg']}" if where else str(fault["msg"]))
    return "; ".join(parts[:3]) + "."
