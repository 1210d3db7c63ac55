"""A zone that a person is drawing: the form behind both ways, by numbers and on the scene.

The ellipse that is drawn is where robots keep out at the accepted risk; the zone's margin comes on
top of it. So its semi-axes are the standard deviations times the quantile of the risk.
Frame ENU; metres, degrees counter-clockwise from east.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any, Final

import numpy as np

Json = dict[str, Any]
Point = tuple[float, float]
Point3 = tuple[float, float, float]

LEAST_SIZE_M: Final = 0.05
GREATEST_SIZE_M: Final = 1000.0
GREATEST_RISK: Final = 0.4
"""At one half the rim says nothing about the size any more."""

FAR: Final = 50.0
"""A click so many field sizes away was aimed at the horizon."""

KINDS: Final = ("sensing", "communication")

RANGES: Final = {
    "x_m": ("East", -1e6, 1e6, "m"),
    "y_m": ("North", -1e6, 1e6, "m"),
    "long_m": ("Semi-axis a", LEAST_SIZE_M, GREATEST_SIZE_M, "m"),
    "short_m": ("Semi-axis b", LEAST_SIZE_M, GREATEST_SIZE_M, "m"),
    "angle_deg": ("Angle", -180.0, 180.0, "°"),
    "margin": ("Margin", 0.0, 1000.0, ""),
    "risk": ("Risk", 0.001, GREATEST_RISK, ""),
}
"""Per field its name for people, its lowest and highest value, its unit."""


@dataclass(frozen=True, slots=True)
class Draft:
    """What the form says. Numbers that are not given yet are None."""

    kind: str = "sensing"
    x_m: float | None = None
    y_m: float | None = None
    long_m: float | None = None
    short_m: float | None = None
    angle_deg: float | None = 0.0
    margin: float | None = None
    """None takes the scenario's."""

    risk: float | None = None
    """None takes the scenario's."""

    def problems(self) -> dict[str, str]:
        """Return per field that is wrong what it should be, in words."""
        found = {}
        if self.kind not in KINDS:
            found["kind"] = "Kind: sensing or communication."
        for name, (title, lowest, highest, unit) in RANGES.items():
            value = getattr(self, name)
            span = f"{lowest:g} to {highest:g}{f' {unit}' if unit else ''}"
            if value is None:
                if name not in ("margin", "risk"):
                    found[name] = f"{title}: a number from {span}."
            elif not (math.isfinite(value) and lowest <= value <= highest):
                found[name] = f"{title}: {value:g} is not within {span}."
        return found

    def zone(self, defaults: Mapping[str, Json]) -> Json:
        """Return the body of a request to draw it. Only for a draft without problems.

        `defaults` are the snapshot's `zone_defaults`: per kind its margin and risk.
        """
        body: Json = {
            "kind": self.kind,
            "mean": (self.x_m, self.y_m),
            "covariance": self.covariance(defaults),
        }
        return body | {
            name: value
            for name, value in (("margin", self.margin), ("risk", self.risk))
            if value is not None
        }

    def covariance(self, defaults: Mapping[str, Json]) -> tuple[Point, Point]:
        """Return the extent (m^2) whose rim at the accepted risk is the ellipse drawn."""
        risk = defaults[self.kind]["risk"] if self.risk is None else self.risk
        factor = quantile(risk)
        a = (float(self.long_m or 0.0) / factor) ** 2
        b = (float(self.short_m or 0.0) / factor) ** 2
        angle = math.radians(self.angle_deg or 0.0)
        c, s = math.cos(angle), math.sin(angle)
        across = (a - b) * c * s
        return (a * c * c + b * s * s, across), (across, a * s * s + b * c * c)

    @property
    def placed(self) -> bool:
        """Whether it has a centre and a size."""
        return not {"x_m", "y_m", "long_m", "short_m", "angle_deg"} & self.problems().keys()


def quantile(risk: float) -> float:
    """Return how many standard deviations off the centre a rim at this risk lies.

    It is sqrt(2) erfinv(1 - 2 risk), never less than that of the greatest risk.
    """
    return NormalDist().inv_cdf(1.0 - min(risk, GREATEST_RISK))


def ground_point(origin: Point3, direction: Point3, span_m: float) -> Point | None:
    """Return where a ray meets the ground z = 0; None beside it or beyond the horizon.

    `span_m` is the size of the field.
    """
    ox, oy, oz = origin
    dx, dy, dz = direction
    if not all(map(math.isfinite, (*origin, *direction))) or abs(dz) < 1e-9:
        return None
    reach = -oz / dz
    if reach <= 0.0:
        return None
    x, y = ox + reach * dx, oy + reach * dy
    return (x, y) if math.hypot(x - ox, y - oy) <= FAR * span_m else None


def clicked(draft: Draft, point: Point) -> Draft:
    """Return the draft after a click on the ground: first the centre, then the rim.

    A click after that begins anew with another centre.
    """
    if draft.x_m is None or draft.y_m is None or draft.long_m is not None:
        return replace(draft, x_m=_tidy(point[0]), y_m=_tidy(point[1]), long_m=None, short_m=None)
    radius = math.hypot(point[0] - draft.x_m, point[1] - draft.y_m)
    size = _tidy(float(np.clip(radius, LEAST_SIZE_M, GREATEST_SIZE_M)))
    return replace(draft, long_m=size, short_m=size, angle_deg=0.0)


def hint(draft: Draft) -> str:
    """Return what the next click does."""
    if draft.x_m is None or draft.y_m is None:
        return "Click the centre on the ground."
    if draft.long_m is None:
        return "Now click the rim."
    return "Check the numbers and draw it, or click another centre."


def _tidy(value: float) -> float:
    """Return a length to the centimetre: what a click can tell."""
    return round(value, 2)
