"""Panels as HTML from snapshot and event messages.

Every word that came from outside (comments, reasons, names) goes through `escape`: what people
and models write is shown as it is read, never run.
"""

import math
from collections.abc import Iterable
from html import escape as html_escape
from typing import Any

from console.picture import robot_state

Json = dict[str, Any]


def escape(text: str) -> str:
    """Return a text for HTML, without marks that would make it read as something else."""
    return html_escape(text.translate(_INVISIBLE))


LOOPS = (("optimizer", "Optimizer"), ("task_llm", "Task model"), ("action_llm", "Action model"))
STALE_PERIODS = 3.0
"""A loop whose last success is older than so many of its periods wants to be looked at."""

PERIODS_S = {"optimizer": 0.1, "task_llm": 20.0, "action_llm": 5.0}
GOOD_SUCCESS = 0.8

GUIDANCE_WORDS = {
    "model": "Model guidance",
    "last_valid": "Last valid guidance",
    "solver": "Own solver",
    "hold": "Hold",
}
STATUS_WORDS = {
    "received": "Received",
    "considered": "Considered",
    "applied": "Applied",
    "partly_applied": "Partly applied",
    "noted": "Noted",
    "declined": "Declined",
    "expired": "Expired",
}
_INVISIBLE = dict.fromkeys((*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x200E, 0x200F, 0x61C))
"""Marks that turn the direction of writing: words could be made to read as others."""

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
WIDE_MATRIX = 16
"""Beyond so many targets the matrix becomes a list: cells would be too small to read."""


def clock(seconds: float | None) -> str:
    """Return mission time as m:ss.t."""
    if seconds is None:
        return "–:––"
    minutes, rest = divmod(max(0.0, seconds), 60.0)
    return f"{int(minutes)}:{rest:04.1f}"


def loop_level(name: str, loop: Json) -> str:
    """Return ok, warn or alarm for one loop's lamp; idle before its first call."""
    if not loop["calls"]:
        return "idle"
    period_s = PERIODS_S[name]
    age_s = loop["age_s"]
    if age_s is None or age_s > STALE_PERIODS * max(period_s, 1.0):
        return "alarm"
    low = loop["success_rate"] is not None and loop["success_rate"] < GOOD_SUCCESS
    return "warn" if low else "ok"


def lamps(snapshot: Json) -> str:
    """Return the three loop lamps: rate or age, and success."""
    parts = []
    for name, title in LOOPS:
        loop = snapshot["loops"].get(name)
        if loop is None:
            continue
        level = loop_level(name, loop)
        if name == "optimizer":
            rate = loop["rate_hz"]
            figure = "–" if rate is None else f"{rate:.1f} Hz"
        else:
            figure = "no answer yet" if loop["age_s"] is None else f"{loop['age_s']:.0f} s ago"
        success = loop["success_rate"]
        share = "" if success is None else f" · {100 * success:.0f} %"
        words = {"ok": "normal", "warn": "low success", "alarm": "stale", "idle": "idle"}[level]
        hint = f"{title}: {words}; {loop['calls']} calls, {loop['missed']} missed"
        parts.append(
            f'<div class="lamp {level}" title="{escape(hint)}">'
            f'<i aria-label="{words}"></i><b>{title}</b><span>{figure}{share}</span></div>'
        )
    return "".join(parts)


def guidance(snapshot: Json) -> str:
    """Return which step of the ladder guides the team, and how old that is."""
    level = snapshot["guidance"]["level"]
    age = snapshot["guidance"]["age_s"]
    tone = {"model": "ok", "last_valid": "warn", "solver": "warn"}.get(level, "alarm")
    since = "" if age is None else f"{age:.0f} s old"
    return (
        f'<div class="guidance {tone}"><b>{GUIDANCE_WORDS.get(level, escape(level))}</b>'
        f"<span>{since}</span></div>"
    )


def figures(snapshot: Json) -> str:
    """Return the mission's figures in one line."""
    solve = snapshot["solve"]
    attacks = snapshot["attacks"]
    trace = snapshot["trace"]
    items = [
        ("Trace", "–" if trace is None else f"{trace:.2f} m²", ""),
        ("Sensing hits", str(attacks["sensing"]), ""),
        ("Link hits", str(attacks["communication"]), ""),
    ]
    if solve is not None:
        tone = "" if solve["rung"] == "converged" else "warn"
        items.append(("Solve", f"{solve['solve_ms']:.1f} ms · {escape(solve['rung'])}", tone))
    return "".join(
        f'<div class="figure {tone}"><span>{name}</span><b>{value}</b></div>'
        for name, value, tone in items
    )


def team(snapshot: Json) -> str:
    """Return the table of robots."""
    assignment = snapshot["directives"]["assignment"]
    capacities = snapshot["directives"]["capacities"]
    rows = []
    for robot in snapshot["robots"]:
        key = str(robot["id"])
        state = robot_state(robot)
        tone = _robot_tone(robot)
        targets = " ".join(f"T{t}" for t in assignment.get(key, ())) or "–"
        speed = "–" if robot["velocity"] is None else f"{math.hypot(*robot['velocity']):.2f}"
        rows.append(
            f'<tr><th scope="row">D{robot["id"]}</th>'
            f'<td class="state {tone}"><i></i>{state}</td>'
            f'<td class="wrap">{targets}</td><td class="num">{capacities.get(key, "–")}</td>'
            f'<td class="num">{speed}</td><td class="num">{_age(robot["state_age_s"])}</td></tr>'
        )
    head = (
        '<th scope="col">Drone</th><th scope="col">State</th><th scope="col">Targets</th>'
        '<th scope="col" class="num">Cap.</th><th scope="col" class="num">m/s</th>'
        '<th scope="col" class="num">Heard</th>'
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def matrix(snapshot: Json) -> str:
    """Return the assignment: a matrix, or a list where it would be too wide."""
    directives = snapshot["directives"]
    if len(snapshot["targets"]) > WIDE_MATRIX:
        return _assignment_list(directives)
    pins = {(p["robot"], p["target"]): p for p in directives["pins"]}
    head = "".join(
        f'<th scope="col" class="{_target_tone(t)}" title="{escape(t["status"])}">T{t["id"]}</th>'
        for t in snapshot["targets"]
    )
    rows = []
    for robot in snapshot["robots"]:
        own = set(directives["assignment"].get(str(robot["id"]), ()))
        cells = []
        for target in snapshot["targets"]:
            pin = pins.get((robot["id"], target["id"]))
            on = target["id"] in own
            words = f"robot {robot['id']}, target {target['id']}: " + (
                "assigned" if on else "not assigned"
            )
            if pin is not None:
                words += ", pinned" + (f" by comment {pin['comment']}" if pin["comment"] else "")
            tone = f"cell{' on' if on else ''}{' pin' if pin else ''} {_robot_tone(robot)}"
            cells.append(f'<td class="{tone}" title="{escape(words)}"><i></i></td>')
        rows.append(f'<tr><th scope="row">D{robot["id"]}</th>{"".join(cells)}</tr>')
    return (
        f'<table class="matrix"><thead><tr><td></td>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def assignment_note(snapshot: Json) -> str:
    """Return who asked for the assignment, and since when it stands."""
    return _since(snapshot, "assignment")


def weights_note(snapshot: Json) -> str:
    """Return who asked for the weights, and since when they stand."""
    return _since(snapshot, "weights")


def weights(snapshot: Json) -> str:
    """Return the weights on logarithmic bars between their bounds."""
    directives = snapshot["directives"]
    rows = []
    for name, value in directives["weights"].items():
        lower, upper = directives["weight_bounds"][name]
        share = 100.0 * _log_share(value, lower, upper)
        rows.append(
            f'<div class="weight"><span>{WEIGHT_WORDS.get(name, escape(name))}</span>'
            f"<b>{value:g}</b>"
            f'<div class="meter" role="meter" aria-label="{escape(name)}" aria-valuemin="{lower:g}"'
            f' aria-valuemax="{upper:g}" aria-valuenow="{value:g}">'
            f'<i style="left:{share:.1f}%"></i></div>'
            f'<small class="low">{lower:g}</small><small class="high">{upper:g}</small></div>'
        )
    return "".join(rows)


def receipts(comments: Iterable[Json]) -> str:
    """Return the conversation, newest first: each comment and what became of it."""
    cards = []
    for comment in reversed(list(comments)):
        status = comment["status"]
        answers = "".join(
            f'<p class="answer"><b>{title}</b> {STATUS_WORDS[answer["verdict"]].lower()}'
            f"{': ' + escape(answer['reason']) if answer['reason'] else ''}</p>"
            for title, answer in (
                ("Task model", comment["task"]),
                ("Action model", comment["action"]),
            )
            if answer is not None
        )
        cards.append(
            f'<article class="receipt {status}" data-comment="{escape(comment["id"])}">'
            f'<header><span class="chip">{STATUS_WORDS[status]}</span>'
            f"<span>{escape(comment['author'])} · {clock(comment['time_s'])}</span></header>"
            f"<p>{escape(comment['text'])}</p>{answers or _waiting(status)}</article>"
        )
    empty = (
        '<p class="empty">Nothing said yet. The models read your comment at their next call; '
        "the answer appears here.</p>"
    )
    return "".join(cards) or empty


def events(recent: Iterable[Json]) -> str:
    """Return the last events, newest first."""
    rows = [
        f'<li class="{escape(event["severity"])}"><time>{clock(event["time_s"])}</time>'
        f"<span>{escape(event['text'])}</span></li>"
        for event in reversed(list(recent))
    ]
    return f"<ol>{''.join(rows)}</ol>" if rows else '<p class="empty">No events yet.</p>'


def suggestions(snapshot: Json | None) -> list[str]:
    """Return sentences that make sense now, ready to be sent or changed."""
    if snapshot is None or not snapshot["robots"] or not snapshot["targets"]:
        return []
    found = []
    worst = max(
        snapshot["targets"],
        key=lambda t: 0.0 if t["covariance"] is None else _trace(t["covariance"]),
    )
    assignment = snapshot["directives"]["assignment"]
    fit = [r for r in snapshot["robots"] if robot_state(r) == "ok"]
    free = next((r for r in fit if worst["id"] not in assignment.get(str(r["id"]), ())), None)
    if free is not None:
        found.append(f"The Drone {free['id']} should focus on tracking target {worst['id']}.")
    found.append("Keep farther away from the sensing zones.")
    found.append("Track more boldly.")
    return found


def _since(snapshot: Json, what: str) -> str:
    directives = snapshot["directives"]
    source = directives[f"{what}_source"]
    return f"{SOURCE_WORDS.get(source, escape(source))}, {clock(directives[f'{what}_since_s'])}"


def _assignment_list(directives: Json) -> str:
    rows = "".join(
        f'<tr><th scope="row">D{escape(robot)}</th><td class="wrap">'
        f"{' '.join(f'T{t}' for t in targets) or '–'}</td></tr>"
        for robot, targets in directives["assignment"].items()
    )
    return f"<table><tbody>{rows}</tbody></table>"


def _robot_tone(robot: Json) -> str:
    if robot["link"] == "lost":
        return "lost"
    if robot["link"] == "jammed":
        return "jammed"
    return "blind" if robot["sensing_failed"] else "well"


def _target_tone(target: Json) -> str:
    return "well" if target["status"] == "tracked" else "coasting"


def _age(age_s: float | None) -> str:
    return "never" if age_s is None else f"{age_s:.1f} s"


def _log_share(value: float, lower: float, upper: float) -> float:
    """Return where a value lies between bounds on a logarithmic scale, 0 to 1."""
    if not 0.0 < lower < upper or value <= 0.0:
        return 0.5
    share = math.log(value / lower) / math.log(upper / lower)
    return min(1.0, max(0.0, share))


def _trace(covariance: list[list[float]]) -> float:
    return covariance[0][0] + covariance[1][1]


def _waiting(status: str) -> str:
    words = "Waiting for the models." if status == "received" else "Its time is over."
    return f'<p class="answer">{words}</p>' if status in {"received", "expired"} else ""
