"""The assignment's panel: press a cell to pin, keep apart, set free; or say it by numbers."""

from typing import ClassVar

from nicegui import ui

from console import assignment
from console.board import Facts
from console.ledger import Ledger
from console.panel import Desk, Panel
from console.panels.parts import number_field, said, small_button
from console.steering import Steering, whole


class AssignmentPanel(Panel):
    """One browser's view of the matrix."""

    note: ClassVar[str] = "assignment-note"
    styles: ClassVar[tuple[str, ...]] = ("parts.css", "assignment.css")
    scripts: ClassVar[tuple[str, ...]] = ("assignment.js",)

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the matrix and who asked for it."""
        if facts.picture is None:
            return {}
        ledger = Ledger() if facts.looking.away else facts.ledger
        return {
            "assignment-note": assignment.note(facts.picture),
            "assignment": assignment.matrix(facts.picture, ledger),
        }

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._robot: ui.number | None = None

    def build(self) -> None:
        """Build the matrix and, for who may steer, the row for numbers."""
        self.desk.taps(self.html("assignment", "scroll assignment"), self._tapped)
        if self.desk.operates:
            with ui.element("div").classes("by-number assignment-by-number"):
                ui.label("D")
                self._robot = number_field("Drone", "pair-robot")
                ui.label("T")
                self._target = number_field("Target", "pair-target")
                small_button("Pin", self._turn, "turns the pair on: pinned, kept apart, free")
                ui.label("max")
                self._most = number_field("Most targets of this drone", "capacity")
                small_button("Set", self._allow, "how many targets this drone may have")

    async def _tapped(self, value: str) -> None:
        if not self.desk.at_present():
            return
        match assignment.tapped(value):
            case "pair", (robot_id, target_id):
                await said(self.desk, lambda hand: hand.turn(robot_id, target_id))
            case "capacity", (robot_id,):
                if self._robot is not None:
                    self._robot.set_value(robot_id)
                    self._most.run_method("focus")

    async def _turn(self) -> None:
        async def turned(hand: Steering) -> str:
            robot_id = whole("Drone", self._robot.value if self._robot else None)
            return await hand.turn(robot_id, whole("Target", self._target.value))

        await said(self.desk, turned)

    async def _allow(self) -> None:
        async def allowed(hand: Steering) -> str:
            robot_id = whole("Drone", self._robot.value if self._robot else None)
            return await hand.allow(robot_id, whole("At most", self._most.value))

        await said(self.desk, allowed)
