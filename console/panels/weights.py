"""The weights' panel: sliders and numbers that are tried out here and put in force as one."""

from dataclasses import dataclass
from typing import Any, ClassVar

from nicegui import ui

from console import weights
from console.board import Facts
from console.panel import Desk, Panel
from console.panels.parts import number_field, said, small_button
from console.render import WEIGHT_WORDS
from console.steering import Steering, refusal

Json = dict[str, Any]
Tried = dict[str, float | None]
"""Weights by name; None for a field that holds no number."""


@dataclass(slots=True)
class _Row:
    """What one weight is shown with."""

    name: str
    number: ui.number
    slider: ui.slider
    bounds: tuple[ui.label, ui.label]


class WeightsPanel(Panel):
    """One browser's trial of weights; until it is changed here it follows what is in force."""

    note: ClassVar[str] = "weights-note"
    styles: ClassVar[tuple[str, ...]] = ("parts.css", "weights.css")

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the weights' histories and who asked for them."""
        snapshot = facts.snapshot
        if snapshot is None:
            return {}
        return {"weights-note": weights.note(snapshot)} | {
            f"weight-{name}": weights.history(snapshot, facts.ledger, name)
            for name in snapshot["directives"]["weights"]
        }

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._rows: dict[str, _Row] = {}
        self._tried: Tried = {}
        """What this person has changed and not yet put in force."""

    def build(self) -> None:
        """Build the panel's content."""
        with ui.element("div").classes("scroll weight-rows"):
            for name, title in WEIGHT_WORDS.items():
                self._rows[name] = self._row(name, title)
        trial = ui.element("div").classes("by-number weights-trial")
        trial.set_visibility(self.desk.operates)
        with trial:
            self._state = ui.label("").classes("trial")
            hint = "all four, verified, in your name"
            self._apply = small_button("Put in force", self._put, hint, weights="apply")
            self._undo = small_button(
                "Discard", self._discard, "back to what is in force", weights="discard"
            )
        self._follow()

    def refresh(self) -> None:
        """Show what is in force, but for what is being tried here."""
        super().refresh()
        self._follow()

    def _follow(self) -> None:
        snapshot = self.desk.board.snapshot
        if snapshot is None:
            return
        directives = snapshot["directives"]
        for name, row in self._rows.items():
            low, high = directives["weight_bounds"][name]
            for label, bound in zip(row.bounds, (low, high), strict=True):
                _say(label, f"{bound:g}")
            if name not in self._tried:
                self._show(row, directives["weights"][name], (low, high))
        self._tell_state(snapshot)

    def _row(self, name: str, title: str) -> _Row:
        with ui.element("div").classes("weight").props(f"data-weight={name}"):
            ui.label(title).classes("weight-name")
            self.html(f"weight-{name}", "weight-history")
            number = number_field(title, f"weight-{name}")
            slider = (
                ui.slider(min=0, max=weights.STEPS, step=1)
                .props(f'dense aria-label="{title}"')
                .classes("weight-slider")
            )
            with ui.element("div").classes("weight-bounds"):
                lowest, highest = ui.label(""), ui.label("")
        row = _Row(name, number, slider, (lowest, highest))
        for control in (number, slider):
            control.set_enabled(self.desk.operates)
        number.on("update:model-value", lambda _: self._typed(row))
        slider.on("update:model-value", lambda event: self._slid(row, event.args), throttle=0.05)
        return row

    def _bounds(self, name: str) -> tuple[float, float] | None:
        snapshot = self.desk.board.snapshot
        if snapshot is None:
            return None
        low, high = snapshot["directives"]["weight_bounds"][name]
        return low, high

    def _typed(self, row: _Row) -> None:
        bounds = self._bounds(row.name)
        if bounds is None:
            return
        self._tried[row.name] = row.number.value
        if row.number.value is not None:
            row.slider.set_value(round(weights.position(row.number.value, bounds)))
        self._tell_state(self.desk.board.snapshot)

    def _slid(self, row: _Row, where: Any) -> None:
        bounds = self._bounds(row.name)
        if bounds is None or not isinstance(where, int | float):
            return
        value = weights.value_at(where, bounds)
        self._tried[row.name] = value
        row.number.set_value(value)
        self._tell_state(self.desk.board.snapshot)

    def _show(self, row: _Row, value: float, bounds: tuple[float, float]) -> None:
        shown = float(f"{value:.4g}")
        where = round(weights.position(value, bounds))
        if row.number.value != shown:
            row.number.set_value(shown)
        if row.slider.value != where:
            row.slider.set_value(where)

    def _tell_state(self, snapshot: Json | None) -> None:
        wrong = self._problems(snapshot)
        words = "The action model may change them again."
        if self._tried:
            words = wrong[0] if wrong else "Tried here, not yet in force."
        _say(self._state, words)
        self._state.classes(add="wrong" if wrong else "", remove="" if wrong else "wrong")
        self._apply.set_enabled(bool(self._tried) and not wrong)
        self._undo.set_enabled(bool(self._tried))

    def _problems(self, snapshot: Json | None) -> list[str]:
        if snapshot is None:
            return []
        bounds = snapshot["directives"]["weight_bounds"]
        found = [weights.problem(name, tried, bounds[name]) for name, tried in self._tried.items()]
        return [words for words in found if words]

    async def _put(self) -> None:
        tried = dict(self._tried)

        async def weighed(hand: Steering) -> str:
            picture = hand.picture()
            if wrong := self._problems(picture):
                raise refusal(" ".join(wrong))
            return await hand.weigh(picture["directives"]["weights"] | tried)

        if await said(self.desk, weighed):
            self._tried = changed_since(self._tried, tried)

    def _discard(self) -> None:
        self._tried.clear()
        self._follow()


def changed_since(tried: Tried, put: Tried) -> Tried:
    """Return what is still only tried after some of it was put in force: what changed meanwhile."""
    return {name: value for name, value in tried.items() if name not in put or put[name] != value}


def _say(label: ui.label, words: str) -> None:
    if label.text != words:
        label.set_text(words)
