"""The known zones in words: what, where, how far it repels, who found or drew it and when."""

import math
from typing import Any, Final

from console.clouds import is_inferred, percent
from console.ledger import Ledger
from console.render import clock, escape

Json = dict[str, Any]

DEFAULT_BOUNDS: Final = (1.0, 5.0)
"""Bounds of severity in pictures of an older recording, which does not tell them."""

FALLBACK: Final = {
    "sensing": {"margin": 0.1, "risk": 0.1},
    "communication": {"margin": 0.2, "risk": 0.05},
}
"""What a drawn zone gets in such pictures. Nothing can be drawn in a recording."""

EMPTY: Final = '<p class="empty">The team knows no zone. Draw one where nobody should fly.</p>'


def severity_bounds(snapshot: Json) -> tuple[float, float]:
    """Return what a severity must lie between."""
    lower, upper = snapshot["directives"].get("severity_bounds", DEFAULT_BOUNDS)
    return float(lower), float(upper)


def defaults(snapshot: Json) -> dict[str, Json]:
    """Return per kind the margin and risk that a drawn zone gets."""
    found: dict[str, Json] = snapshot.get("zone_defaults", FALLBACK)
    return found


def line(zone: Json, snapshot: Json, ledger: Ledger) -> str:
    """Return one known zone: its kind, name, place, size and origin."""
    x, y = zone["mean"]
    long, short = zone["keep_out_axes_m"]
    kind = escape(zone["kind"])
    look = f"{kind} cloud" if is_inferred(zone) else kind
    size = f"{long:.1f} m" if f"{long:.1f}" == f"{short:.1f}" else f"{long:.1f} × {short:.1f} m"
    return (
        f'<div class="zone {look}"><i aria-hidden="true"></i><b>{escape(zone["id"])}</b>'
        f"<span>{kind}</span><span>({x:.1f}, {y:.1f})</span>"
        f'<span title="where it repels, semi-axes">{size}</span>'
        f"<small>{escape(origin(zone, ledger))}{_ignorant(zone, snapshot)}</small></div>"
    )


def origin(zone: Json, ledger: Ledger) -> str:
    """Return how and when a zone became known, how sure that is, and who set its severity."""
    found = ledger.zone(zone["id"])
    if is_inferred(zone):
        words = _inferred(zone)
    else:
        words = "known from the start" if found is None else f"{found[0]} at {clock(found[1])}"
    credit = ledger.severity(zone["id"])
    if credit is not None:
        words += f"; severity by {credit.who} at {clock(credit.time_s)}"
    return words


def _inferred(zone: Json) -> str:
    (a, _), (_, b) = zone["inferred"]["centre_covariance"]
    return (
        f"inferred, {percent(zone['confidence'])} sure; centre to {math.sqrt(a + b):.1f} m; "
        f"suspected since {clock(zone['inferred']['since_s'])}"
    )


def _ignorant(zone: Json, snapshot: Json) -> str:
    """Return which robots do not know of a zone, if only some do not."""
    holders = set(zone["known_by"])
    missing = [f"D{robot['id']}" for robot in snapshot["robots"] if robot["id"] not in holders]
    return f"; not known to {' '.join(missing)}" if missing else ""
