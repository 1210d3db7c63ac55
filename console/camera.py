"""Where a camera of the scene stands so that it sees the whole field."""

import math
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np

from console.shapes import Floats

Json = dict[str, Any]
Point3 = tuple[float, float, float]

USUAL_ASPECT: Final = 1.75
USUAL_FOV: Final = np.deg2rad(75.0)
USUAL_HEIGHT_PX: Final = 400.0
"""Of a view that nobody has opened yet."""

FILLED: Final = 0.86
"""So much of a view's width the field may take."""

ABOVE_PX: Final = 80.0
BELOW_PX: Final = 44.0
"""What buttons and figures above the field, with the label of a robot at its edge, and the legend
below it cover."""

LEAST_FILLED: Final = 0.3
"""A low view shows the field so large at least, from its middle to either edge."""

AIMS: Final = np.linspace(0.0, 0.7, 36)
"""Where a camera may look: shares of the field from its south."""

ALIKE: Final = 1.1
"""Distances that differ by less are taken for the same."""


def whole_field(
    snapshot: Json,
    aspect: float = USUAL_ASPECT,
    fov: float = USUAL_FOV,
    height_px: float = USUAL_HEIGHT_PX,
) -> tuple[Point3, Point3]:
    """Return where a viewer stands who sees the whole field, and what it looks at.

    It looks from the south, from above, as near as a view of this `aspect` (width over height),
    vertical field of view `fov` (radians) and height allows, and nothing between the ground and
    the highest robot lies under what is shown over the scene.
    """
    (x0, y0), (x1, y1) = snapshot["field"]["lower"], snapshot["field"]["upper"]
    levels = {0.0, max((r["position"][2] for r in snapshot["robots"] if r["position"]), default=0)}
    corners = np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in sorted(levels)])
    back = np.array([0.0, -0.62, 0.79])
    back /= np.linalg.norm(back)
    up = np.array([0.0, back[2], -back[1]])
    slope = np.tan(0.5 * fov)
    wide = FILLED * slope * aspect
    top, bottom = (
        slope * max(LEAST_FILLED, 1.0 - 2.0 * covered / height_px)
        for covered in (ABOVE_PX, BELOW_PX)
    )
    # What is nearer looks larger: the middle of the picture lies south of the field's own.
    aims = np.array([(0.5 * (x0 + x1), y0 + s * (y1 - y0), 0.0) for s in AIMS])
    offsets = corners[None, :, :] - aims[:, None, :]
    # In view are points with |x| <= wide * depth and -bottom * depth <= y <= top * depth: the
    # depth that each one needs.
    rise = offsets @ up
    needed = np.maximum(np.abs(offsets[..., 0]) / wide, np.maximum(rise / top, -rise / bottom))
    distances = (needed + offsets @ back).max(axis=1)
    heights = rise / (distances[:, None] - offsets @ back)
    # Of those about as near, the one that has as much room above the field as below.
    uneven = np.abs((top - heights.max(axis=1)) - (bottom + heights.min(axis=1)))
    best = int(np.argmin(np.where(distances <= ALIKE * distances.min(), uneven, np.inf)))
    aim = aims[best]
    place = aim + distances[best] * back
    return (float(place[0]), float(place[1]), float(place[2])), (float(aim[0]), float(aim[1]), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """How a camera maps the world onto its picture; lengths there are in heights of the picture."""

    position: Floats
    right: Floats
    up: Floats
    ahead: Floats
    """Unit vectors of the camera, shape (3,)."""

    fov: float
    """Vertical field of view, radians."""

    @classmethod
    def at(cls, position: Point3, look_at: Point3, fov: float = USUAL_FOV) -> Self:
        """Return the lens of a camera that stands upright and does not look straight down."""
        place = np.array(position, dtype=float)
        ahead = np.array(look_at, dtype=float) - place
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        return cls(place, right, np.cross(right, ahead), ahead, float(fov))

    def span_m(self, point: Point3) -> float:
        """Return how many metres the height of the picture spans where a point is."""
        return self._span_m(np.subtract(point, self.position))

    def seen(self, point: Point3) -> tuple[float, float]:
        """Return where a point is in the picture: across and up from its middle."""
        offset = np.subtract(point, self.position)
        span_m = self._span_m(offset)
        return float(offset @ self.right) / span_m, float(offset @ self.up) / span_m

    def beside(self, point: Point3, across: float, up: float) -> Point3:
        """Return the point that is seen so far beside another one, as near as that one."""
        x, y, z = point + self.span_m(point) * (across * self.right + up * self.up)
        return float(x), float(y), float(z)

    def _span_m(self, offset: Floats) -> float:
        return 2.0 * max(0.01, float(offset @ self.ahead)) * math.tan(0.5 * self.fov)
