"""Zones that were inferred: how they look, and how sure they are in words."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from console.shapes import Floats, ellipses, headings

Json = dict[str, Any]

SHELLS: Final = 12
"""Discs of one cloud."""

SHELL_OPACITY: Final = 0.055
"""Of one disc of a cloud that is certain."""

_INNER, _OUTER = 0.15, 1.2
"""Smallest and largest disc, as shares of how far the zone repels."""

_GROUND_M, _APART_M = 0.016, 0.003
"""Height of the largest disc, and between two: lying in each other they would flicker."""


def is_inferred(zone: Json) -> bool:
    """Whether a zone was inferred from failures; pictures of old recordings do not say so."""
    return bool(zone.get("origin") == "inferred")


def percent(share: float) -> str:
    """Return a probability in per cent; never all of them."""
    return f"{min(99, round(100.0 * share))} %"


def cloud_shells(zones: Sequence[Json]) -> tuple[Floats, Floats, Floats]:
    """Return discs in discs for each of N zones: together they fade from the middle outwards.

    Positions, quaternions and scales, each of N * SHELLS rows, a zone's own one after another.
    """
    shares = np.linspace(_OUTER, _INNER, SHELLS)
    _, angles = ellipses([zone["covariance"] for zone in zones])
    axes = np.array([zone["keep_out_axes_m"] for zone in zones], dtype=float).reshape(-1, 2)
    means = np.array([zone["mean"] for zone in zones], dtype=float).reshape(-1, 2)
    heights = np.tile(_GROUND_M + _APART_M * np.arange(SHELLS), len(zones))
    sizes = (axes[:, None] * shares[:, None]).reshape(-1, 2)
    return (
        np.column_stack([np.repeat(means, SHELLS, axis=0), heights]),
        headings(np.repeat(angles, SHELLS)),
        np.column_stack([sizes, np.ones(len(sizes))]),
    )
