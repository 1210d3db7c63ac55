"""The zones' panel: those the team knows, with their severities; erase, undo, add by numbers."""

from dataclasses import dataclass
from typing import Any, ClassVar, Final

from nicegui import ui

from console import zones
from console.board import Facts
from console.panel import Desk, Panel
from console.panels.parts import in_person, said, small_button
from console.steering import Steering

Json = dict[str, Any]

SHOWN: Final = 64
"""Zones with controls of their own; more are counted only."""


@dataclass(slots=True)
class _Row:
    """One zone's elements."""

    element: ui.element
    slider: ui.slider
    severity: ui.label
    held: bool = False
    """Whether somebody here is moving the slider."""

    left_at: float | None = None
    """Where they let go of it: news of that place may come after the news that they did."""


class ZonesPanel(Panel):
    """One browser's list of the known zones."""

    styles: ClassVar[tuple[str, ...]] = ("parts.css", "zones.css")

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return a line per zone, and how many there are."""
        snapshot = facts.snapshot
        if snapshot is None:
            return {}
        known = snapshot["zones"]
        more = len(known) - SHOWN
        note = zones.EMPTY if not known else ""
        if more > 0:
            note = f'<p class="empty">and {more} more, by HTTP</p>'
        return {"zones-note": note} | {
            f"zone-{zone['id']}": zones.line(zone, snapshot, facts.ledger) for zone in known[:SHOWN]
        }

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._rows: dict[str, _Row] = {}
        self._erased: Json | None = None

    def build(self) -> None:
        """Build the list; its rows come and go with the zones."""
        with ui.element("div").classes("scroll zones"):
            self._list = ui.element("div").classes("zone-rows")
            self.html("zones-note", "zones-note")
        self._undo_row = ui.element("div").classes("by-number zones-undo")
        with self._undo_row:
            self._undo_words = ui.label("")
            small_button("Undo", self._restore, "draws it again, under a new name", zones="undo")
        self._undo_row.set_visibility(False)
        self._follow()

    def refresh(self) -> None:
        """Follow the zones of the snapshot."""
        self._follow()
        super().refresh()

    def _follow(self) -> None:
        snapshot = self.desk.board.snapshot
        known = [] if snapshot is None else snapshot["zones"][:SHOWN]
        ids = {zone["id"] for zone in known}
        for gone in self._rows.keys() - ids:
            self._rows.pop(gone).element.delete()
            self._pieces.pop(f"zone-{gone}", None)
        for zone in known:
            row = self._rows.get(zone["id"])
            if row is None:
                with self._list:
                    row = self._rows[zone["id"]] = self._row(zone["id"], snapshot or {})
            if not row.held:
                _show(row, zone["severity"])

    def _row(self, zone_id: str, snapshot: Json) -> _Row:
        lowest, highest = zones.severity_bounds(snapshot)
        element = ui.element("div").classes("zone-row")
        element.props["data-zone"] = zone_id
        with element:
            self.html(f"zone-{zone_id}", "zone-line")
            with ui.element("div").classes("zone-severity"):
                ui.label("severity")
                slider = ui.slider(min=lowest, max=highest, step=0.1, value=lowest)
                slider.props("dense").props["aria-label"] = f"Severity of zone {zone_id}"
                slider.set_enabled(self.desk.operates)
                severity = ui.label("").classes("zone-value")
                if self.desk.operates:
                    small_button(
                        "Erase",
                        lambda: self._erase(zone_id),
                        "one that is really there comes back when it hits again",
                        **{"zone-erase": zone_id},
                    )
        row = _Row(element, slider, severity)
        slider.on("update:model-value", lambda event: _hold(row, event.args), throttle=0.05)
        slider.on("change", lambda event: self._weigh(row, zone_id, event.args))
        return row

    async def _weigh(self, row: _Row, zone_id: str, severity: Any) -> None:
        if isinstance(severity, int | float):
            row.left_at = severity
            await said(self.desk, lambda hand: hand.weigh_zone(zone_id, round(severity, 2)))
        row.held = False

    async def _erase(self, zone_id: str) -> None:
        erased = await in_person(self.desk, lambda hand: hand.erase(zone_id))
        if erased is not None:
            self._erased = erased
            self._undo_words.set_text(f"Zone {zone_id} is erased.")
            self._undo_row.set_visibility(True)

    async def _restore(self) -> None:
        erased = self._erased
        if erased is None:
            return

        async def restored(hand: Steering) -> str:
            drawn = await hand.restore(erased)
            return f"Zone {erased['id']} is back as {drawn['id']}."

        if await said(self.desk, restored):
            self._erased = None
            self._undo_row.set_visibility(False)


def _hold(row: _Row, severity: Any) -> None:
    """Let a slider be while it is moved; where it was left it follows the mission again."""
    if isinstance(severity, int | float) and severity != row.left_at:
        row.held, row.left_at = True, None
        row.severity.set_text(f"{severity:.1f}")


def _show(row: _Row, severity: float) -> None:
    if row.slider.value != severity:
        row.slider.set_value(severity)
    words = f"{severity:.1f}"
    if row.severity.text != words:
        row.severity.set_text(words)
