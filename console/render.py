"""Words and signs that the panels share.

Every word that came from outside (comments, reasons, names) goes through `escape`: what people
and models write is shown as it is read, never run.
"""

from html import escape as html_escape
from typing import Any

Json = dict[str, Any]


def escape(text: str) -> str:
    """Return a text for HTML, without marks that would make it read as something else."""
    return html_escape(text.translate(_INVISIBLE))


STATUS_WORDS = {
    "received": "Received",
    "considered": "Considered",
    "applied": "Applied",
    "partly_applied": "Partly applied",
    "noted": "Noted",
    "declined": "Declined",
    "expired": "Expired",
}
WEIGHT_WORDS = {
    "tracking": "Tracking",
    "control": "Effort",
    "sensing": "Sensing safety",
    "communication": "Link safety",
}
SOURCE_WORDS = {
    "scenario": "scenario",
    "task_llm": "task model",
    "action_llm": "action model",
    "exact": "exact solver",
    "repair": "repair",
    "operator": "operator",
}

_INVISIBLE = dict.fromkeys((*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x200E, 0x200F, 0x61C))
"""Marks that turn the direction of writing: words could be made to read as others."""


def clock(seconds: float | None) -> str:
    """Return mission time as m:ss.t."""
    if seconds is None:
        return "–:––"
    minutes, rest = divmod(max(0.0, seconds), 60.0)
    return f"{int(minutes)}:{rest:04.1f}"


def since(snapshot: Json, what: str) -> str:
    """Return who asked for the assignment or the weights, and since when they stand."""
    directives = snapshot["directives"]
    source = directives[f"{what}_source"]
    return f"{SOURCE_WORDS.get(source, escape(source))}, {clock(directives[f'{what}_since_s'])}"


def robot_tone(robot: Json) -> str:
    """Return the CSS class of a robot's state."""
    if robot["link"] == "lost":
        return "lost"
    if robot["link"] == "jammed":
        return "jammed"
    return "blind" if robot["sensing_failed"] else "well"


def target_tone(target: Json) -> str:
    """Return the CSS class of a target's state."""
    return "well" if target["status"] == "tracked" else "coasting"
