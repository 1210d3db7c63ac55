"""What lies over the scene: the camera's buttons, and the form of a zone that is being drawn."""

import math
from dataclasses import replace
from typing import Any, ClassVar, Final

from nicegui import ui

from console import drawing, zones
from console.drawing import Draft, Point3
from console.panel import Desk, Panel
from console.panels.parts import in_person, number_field, small_button
from console.pencil import Ellipse, Pencil
from console.picture import sign_scale
from console.steering import Steering, refusal

Json = dict[str, Any]

FIELDS: Final = {
    "x_m": "zone-x",
    "y_m": "zone-y",
    "long_m": "zone-long",
    "short_m": "zone-short",
    "angle_deg": "zone-angle",
    "margin": "zone-margin",
    "risk": "zone-risk",
}
"""Per field of a draft its `data-field`."""

NO_VIEW: Final = "This page shows no scene: give the zone by numbers."
VIEW_GONE: Final = "The scene was opened anew; press Draw zone again to click in it."


class ViewPanel(Panel):
    """One browser's camera and pencil."""

    styles: ClassVar[tuple[str, ...]] = ("parts.css", "view.css")
    scripts: ClassVar[tuple[str, ...]] = ("view.js",)

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._draft = Draft()
        self._fields: dict[str, ui.number] = {}
        self._pencil = Pencil(self._find_view, self._clicked)
        self._drawing = False
        self._clicks = False
        """Whether clicks in the scene were being taken."""

    def build(self) -> None:
        """Build the buttons and, for who may steer, the form."""
        with ui.element("div").classes("view-tools"):
            small_button("Fit", self._fit, "show the whole field (F)", view="fit")
            self._follow = small_button(
                "Follow", self._turn_follow, "let the camera go with the team", view="follow"
            )
            if self.desk.operates:
                small_button("Draw zone", self._start, "click it in the scene (Z)", draw="start")
        if self.desk.operates:
            self._form()

    def refresh(self) -> None:
        """Notice a view that has gone, and show what the form misses."""
        super().refresh()
        if self._clicks and not self._pencil.held:
            self._clicks = False
            self._pencil.lay_down()
            if self._drawing:
                self.desk.tell(VIEW_GONE)

    def close(self) -> None:
        """Take no more clicks, and let the camera be."""
        self._pencil.lay_down()
        if self.desk.board.scene is not None:
            self.desk.board.scene.leave(self.desk.view)

    # ------------------------------------------------------------------ camera

    def _fit(self) -> None:
        scene, picture = self.desk.board.scene, self.desk.board.picture
        if scene is not None and picture is not None:
            scene.fit(self.desk.view, picture)
        self._follow.classes(remove="chosen")

    def _turn_follow(self) -> None:
        scene = self.desk.board.scene
        if scene is None:
            return
        if scene.follows(self.desk.view):
            scene.leave(self.desk.view)
            self._follow.classes(remove="chosen")
        else:
            scene.follow(self.desk.view)
            self._follow.classes(add="chosen")

    # ------------------------------------------------------------------ drawing

    def _form(self) -> None:
        self._box = ui.element("div").classes("draw-box")
        self._box.set_visibility(False)
        with self._box:
            self._hint = ui.label("").classes("draw-hint")
            self._kind = (
                ui.toggle(list(drawing.KINDS), value="sensing", on_change=self._chosen)
                .props("unelevated no-caps dense toggle-color=chosen toggle-text-color=chosen")
                .classes("draw-kind")
            )
            with ui.element("div").classes("draw-fields"):
                for name, key in FIELDS.items():
                    title, *_, unit = drawing.RANGES[name]
                    with ui.element("label").classes("draw-field"):
                        short = title.removeprefix("Semi-axis ")
                        ui.label(f"{short}, {unit}" if unit else short)
                        field = self._fields[name] = number_field(title, key)
                        field.on("update:model-value", lambda _: self._typed())
            self._problem = ui.label("").classes("draw-problem")
            with ui.element("div").classes("draw-end"):
                hint = "the whole connected team knows it from then on"
                self._confirm = small_button("Draw", self._finish, hint, draw="confirm")
                small_button("Cancel", self._stop, "Escape", draw="cancel", escape="")

    def _find_view(self) -> Any:
        scene = self.desk.board.scene
        return None if scene is None else scene.view(self.desk.view)

    def _start(self) -> None:
        """Show the form and take clicks in this page's own view."""
        if not self.desk.at_present():
            return
        self._drawing = True
        self._set(Draft(kind=self._draft.kind))
        self._box.set_visibility(True)
        self._clicks = self._pencil.take()
        if not self._clicks:
            self.desk.tell(NO_VIEW)

    def _stop(self) -> None:
        self._drawing = self._clicks = False
        self._pencil.lay_down()
        self._box.set_visibility(False)

    def _clicked(self, origin: Point3, direction: Point3) -> None:
        snapshot = self.desk.board.snapshot
        if snapshot is None:
            return
        (x0, y0), (x1, y1) = snapshot["field"]["lower"], snapshot["field"]["upper"]
        point = drawing.ground_point(origin, direction, math.hypot(x1 - x0, y1 - y0))
        if point is not None:
            self._set(drawing.clicked(self._draft, point))

    def _set(self, draft: Draft) -> None:
        """Show a draft in the form and on the scene."""
        self._draft = draft
        for name, field in self._fields.items():
            value = getattr(draft, name)
            if field.value != value:
                field.set_value(value)
        self._show()

    def _typed(self) -> None:
        self._draft = replace(
            self._draft, **{name: field.value for name, field in self._fields.items()}
        )
        self._show()

    def _chosen(self) -> None:
        if self._kind.value in drawing.KINDS:
            self._draft = replace(self._draft, kind=str(self._kind.value))
            self._show()

    def _show(self) -> None:
        draft, snapshot = self._draft, self.desk.board.snapshot
        wrong = draft.problems()
        self._hint.set_text(drawing.hint(draft))
        begun = draft.placed or draft.long_m is not None
        self._problem.set_text(next(iter(wrong.values()), "") if begun else "")
        self._confirm.set_enabled(not wrong)
        if snapshot is None:
            return
        self._placeholders(zones.defaults(snapshot)[draft.kind])
        self._pencil.show(_ellipse(draft), 0.15 * sign_scale(snapshot))

    def _placeholders(self, given: Json) -> None:
        """Show in the empty fields what the scenario will give them."""
        for name in ("margin", "risk"):
            field = self._fields[name]
            if field.props.get("placeholder") != f"{given[name]:g}":
                field.props(f'placeholder="{given[name]:g}"')

    async def _finish(self) -> None:
        draft = self._draft

        async def drawn(hand: Steering) -> Json:
            if wrong := draft.problems():
                raise refusal(" ".join(wrong.values()))
            return await hand.draw(draft.zone(zones.defaults(hand.picture())))

        zone = await in_person(self.desk, drawn)
        if zone is not None:
            self._stop()
            self.desk.tell(f"Zone {zone['id']} is drawn: the team keeps away from it.")


def _ellipse(draft: Draft) -> Ellipse | None:
    """Return what the scene shows of a draft."""
    if draft.x_m is None or draft.y_m is None or {"x_m", "y_m"} & draft.problems().keys():
        return None
    axes = None
    if draft.placed and draft.long_m is not None and draft.short_m is not None:
        axes = (draft.long_m, draft.short_m)
    return Ellipse((draft.x_m, draft.y_m), axes, math.radians(draft.angle_deg or 0.0), draft.kind)
