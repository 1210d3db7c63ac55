"""Drawing on the scene: one page takes the clicks of its own view, and of no other.

viser listens for clicks per client. They are asked for in the view of the page that draws while
it draws; what other browsers send meanwhile, or this one before and after, has nobody to go to.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import viser

from console.drawing import Point3
from console.layers import Signs
from console.picture import COMMUNICATION, SENSING, Colour
from console.shapes import diamond, disc, headings, moved, ring

Clicked = Callable[[Point3, Point3], None]

COLOURS: dict[str, Colour] = {"sensing": SENSING, "communication": COMMUNICATION}
_HEIGHT_M = 0.05
"""Above the zones that are known."""

_RIM_LIFT_M = (0.0, 0.0, 0.03)
"""And the rim above the area, or the two would flicker through each other."""


@dataclass(slots=True)
class Ellipse:
    """What is shown of a draft: centre, semi-axes in metres (None: only the centre), radians."""

    centre: tuple[float, float]
    axes: tuple[float, float] | None
    angle: float
    kind: str


class Pencil:
    """Owner of the clicks and the preview in one page's view."""

    def __init__(self, find: Callable[[], viser.ClientHandle | None], clicked: Clicked) -> None:
        self._find = find
        self._clicked = clicked
        self._client: viser.ClientHandle | None = None
        self._handler: Callable[[Any], None] | None = None
        self._signs: tuple[Signs, Signs, Signs] | None = None

    @property
    def held(self) -> bool:
        """Whether clicks are taken, and the view they come from is still there."""
        return self._client is not None and self._find() is self._client

    def take(self) -> bool:
        """Take clicks from now on; False where this page shows no scene."""
        self.lay_down()
        client = self._find()
        if client is None:
            return False
        loop = asyncio.get_running_loop()

        def on_click(event: viser.SceneClickEvent) -> None:  # in a thread of viser
            loop.call_soon_threadsafe(self._take, client, event.ray_origin, event.ray_direction)

        client.scene.on_click()(on_click)
        self._client, self._handler = client, on_click
        self._signs = (
            Signs(client.scene, "/draft_area", disc(), 0.35),
            Signs(client.scene, "/draft_rim", moved(ring(0.96), _RIM_LIFT_M), 0.95),
            Signs(client.scene, "/draft_centre", diamond(), 0.95),
        )
        return True

    def lay_down(self) -> None:
        """Take no more clicks and show nothing."""
        client, handler = self._client, self._handler
        if client is not None and handler is not None and self.held:
            self.show(None, 0.0)
            client.scene.remove_click_callback(handler)
        self._client, self._handler, self._signs = None, None, None

    def show(self, ellipse: Ellipse | None, mark_m: float) -> None:
        """Show a draft in this view; `mark_m` is the size of the mark at its centre."""
        if self._signs is None or self._client is None:
            return
        area, rim, centre = self._signs
        with self._client.atomic():
            if ellipse is None:
                for signs in self._signs:
                    signs.clear()
                return
            place = [(*ellipse.centre, _HEIGHT_M)]
            colours = [COLOURS[ellipse.kind]]
            centre.show(place, headings([0.0]), [(mark_m, mark_m, mark_m)], colours)
            if ellipse.axes is None:
                area.clear()
                rim.clear()
                return
            for signs in (area, rim):
                signs.show(place, headings([ellipse.angle]), [(*ellipse.axes, 1.0)], colours)

    def _take(self, client: viser.ClientHandle, origin: Point3, direction: Point3) -> None:
        """Pass a click on, on our own loop, unless it was laid down meanwhile."""
        if client is self._client:
            self._clicked(origin, direction)
