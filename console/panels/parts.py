"""What the panels that steer have in common: small fields and buttons, and one way to act."""

from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Final, TypeVar

from nicegui import ui
from nicegui.events import ClickEventArguments, Handler

from console.panel import Desk
from console.render import escape
from console.steering import Steering

_Done = TypeVar("_Done")
_VALUE: Final = "(event) => emit(event.target.value)"


async def in_person(desk: Desk, act: Callable[[Steering], Awaitable[_Done]]) -> _Done | None:
    """Let this page's person do something; None where it was refused, and they were told."""
    return await desk.act(lambda service, mission, author: act(Steering(service, mission, author)))


async def said(desk: Desk, act: Callable[[Steering], Awaitable[str]]) -> bool:
    """Do the same and tell what was done. Return whether it was."""
    words = await in_person(desk, act)
    if words is not None:
        desk.tell(words)
    return words is not None


def number_field(title: str, key: str) -> ui.number:
    """Return a small number input; `key` names it for style and tests."""
    field = ui.number().props("dense borderless hide-bottom-space step=any").classes("number")
    field.props["aria-label"] = title
    field.props["data-field"] = key
    return field


def small_button(
    text: str, pressed: Handler[ClickEventArguments], hint: str, **data: str
) -> ui.button:
    """Return a small button; `data` become its data attributes."""
    button = ui.button(text, on_click=pressed, color=None).props("flat no-caps dense")
    button.props["title"] = hint
    for name, value in data.items():
        button.props[f"data-{name}"] = value
    return button.classes("small-button")


def choice(
    title: str, options: Sequence[str], choose: Callable[[str], None], first: str = ""
) -> None:
    """Make a list of options; `choose` is told which one it shows, now and when that changes.

    It shows the first one, or the one that is named as `first`.
    """
    shown = first or options[0]
    with ui.element("label").classes("choice"):
        ui.html(f"<span>{title}</span>", sanitize=False, tag="span")
        select = ui.element("select").classes("field")
        with select:
            for option in options:
                item = ui.html(escape(option), sanitize=False, tag="option")
                item.props["value"] = option
                item.props["selected"] = option == shown

    def chosen(event: Any) -> None:
        if event.args in options:
            choose(event.args)

    select.on("change", chosen, js_handler=_VALUE)
    choose(shown)
