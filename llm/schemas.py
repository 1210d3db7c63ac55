"""JSON schemas of the answers, built from the team, so that much cannot be said wrongly.

Only features that strict structured output knows everywhere: objects whose properties are
all required, arrays with `maxItems`, enumerations. What the grammar cannot hold (beta,
repeated ids) the verification does.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Any

from llm.coverage import Team
from llm.verification import WEIGHT_NAMES, Limits
from solver.directives import CommentVerdict
from solver.observations import Link
from solver.snapshot import Snapshot

LONGEST_FEEDBACK = 400
"""Characters of a text to people that are asked for at most; more is read all the same."""

WEIGHT_LEVELS = 9
"""Steps of a weight between its bounds in the compact style."""

MOST_ROWS = 128
"""Rows enumerated per robot at most."""

SHORT_FEEDBACK = 100
"""The same of models that are asked to be brief."""

LEVELS = "levels"
"""Weights in steps, for models that copy numbers rather than reckon."""

FULL_ROWS = "full_rows"
"""Each robot gets its even share of the targets at least, for models that leave rows empty."""

BRIEF = "brief"
"""Short texts, for models that go on for ever."""

Schema = dict[str, Any]


def task_schema(team: Team, comments: Sequence[str], extras: Sequence[str]) -> Schema:
    """Return the schema of a task answer.

    Args:
        team: Robots that can be reached, targets that count, effective capacities.
        comments: Labels of the comments to be answered.
        extras: What is offered: "capacities"; and how: FULL_ROWS, BRIEF.
    """
    targets: Schema = {"type": "integer"}
    if team.targets:
        targets["enum"] = list(team.targets)
    reachable = [r for r, link in team.links.items() if link is Link.CONNECTED]
    share = -(-len(team.targets) // max(1, len(reachable))) if FULL_ROWS in extras else 0
    rows = {
        str(robot_id): _choices(team.targets, share, team.capacities[robot_id])
        or {"type": "array", "items": targets, "maxItems": team.capacities[robot_id]}
        for robot_id in reachable
    }
    properties: Schema = {"assignment": _object(rows)}
    if "capacities" in extras:
        pair = {
            "drone": {"type": "integer", "enum": [int(robot_id) for robot_id in rows]},
            "capacity": {"type": "integer", "minimum": 0, "maximum": len(team.targets)},
        }
        properties["capacities"] = _several(_object(pair), len(rows))
    return _object(properties | _common(comments, extras))


def action_schema(
    snapshot: Snapshot,
    limits: Limits,
    zones: Sequence[str],
    comments: Sequence[str],
    extras: Sequence[str],
) -> Schema:
    """Return the schema of an action answer.

    Args:
        snapshot: The team.
        limits: Bounds of weights and severities.
        zones: Labels of the known zones.
        comments: Labels of the comments to be answered.
        extras: What is offered: "severities", "replan"; and how: LEVELS, BRIEF.
    """
    bounds = zip(WEIGHT_NAMES, limits.weights_lower, limits.weights_upper, strict=True)
    levels = LEVELS in extras
    weights = {
        name: (
            {"type": "number", "enum": weight_levels(lower, upper)}
            if levels
            else {"type": "number", "minimum": lower, "maximum": upper}
        )
        for name, lower, upper in bounds
    }
    properties: Schema = {"weights": _object(weights)}
    if "severities" in extras and zones:
        pair = {
            "zone": {"type": "string", "enum": list(zones)},
            "severity": {
                "type": "number",
                "minimum": limits.severity_lower,
                "maximum": limits.severity_upper,
            },
        }
        properties["severities"] = _several(_object(pair), len(zones))
    reachable = [
        robot_id
        for robot_id, link in zip(snapshot.robots.ids, snapshot.robots.links, strict=True)
        if link is Link.CONNECTED
    ]
    if "replan" in extras and reachable:
        robots = {"type": "integer", "enum": reachable}
        properties["replan"] = _several(robots, len(reachable))
    return _object(properties | _common(comments, extras))


def _choices(targets: Sequence[int], least: int, most: int) -> Schema:
    """Enumerate the rows a robot may have, where they are few; nothing otherwise.

    Each row has at least its even share of the targets and none of them twice, which a
    grammar cannot forbid in any other way.
    """
    sizes = range(min(least, most), most + 1) if least else ()
    if not sizes or sum(math.comb(len(targets), size) for size in sizes) > MOST_ROWS:
        return {}
    rows = [list(row) for size in sizes for row in itertools.combinations(targets, size)]
    return {"enum": rows}


def weight_levels(lower: float, upper: float) -> list[float]:
    """Return geometric steps from one bound to the other, for models that copy numbers."""
    ratio = (upper / lower) ** (1.0 / (WEIGHT_LEVELS - 1))
    inner = [float(f"{lower * ratio**k:.3g}") for k in range(1, WEIGHT_LEVELS - 1)]
    return sorted({lower, *(min(max(level, lower), upper) for level in inner), upper})


def _common(comments: Sequence[str], extras: Sequence[str]) -> Schema:
    longest = SHORT_FEEDBACK if BRIEF in extras else LONGEST_FEEDBACK
    properties: Schema = {"feedback": {"type": "string", "maxLength": longest}}
    if comments:
        answer = {
            "id": {"type": "string", "enum": list(comments)},
            "verdict": {"type": "string", "enum": [verdict.value for verdict in CommentVerdict]},
            "reason": {"type": "string", "maxLength": longest},
        }
        properties["comments"] = _several(_object(answer), len(comments))
    return properties


def _object(properties: Schema) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def _several(items: Schema, most: int) -> Schema:
    return {"type": "array", "items": items, "maxItems": most}
