"""The robots, each with its state, targets, capacity and silence."""

import math
from collections.abc import Iterable, Mapping

from console.board import Facts
from console.cards import assigned_robots
from console.panel import Panel
from console.panels.decisions import CARDS_LOOKED_AT
from console.picture import robot_state
from console.render import Json, escape, robot_tone


class TeamPanel(Panel):
    """The table of robots."""

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the table."""
        if facts.picture is None:
            return {}
        if facts.looking.away:  # the newest decisions are not behind what was
            return {"team": team(facts.picture, {})}
        cards = facts.service.newest_decisions(facts.mission.id, CARDS_LOOKED_AT)
        return {"team": team(facts.picture, last_decisions(cards), facts.silent_s)}

    def build(self) -> None:
        """Show it."""
        self.html("team", "scroll team")


def last_decisions(newest_first: Iterable[Json]) -> dict[int, str]:
    """Return per robot the newest decision in force that was about it."""
    found: dict[int, str] = {}
    for card in newest_first:
        if card.get("status") == "adopted":
            for robot in assigned_robots(card):
                found.setdefault(robot, card["id"])
    return found


def team(snapshot: Json, decided: Mapping[int, str], silent_s: float = 0.0) -> str:
    """Return the table of robots; `decided` names the decision that gave each its targets.

    `silent_s` is for how long the planner has told nothing new: states are what they were then.
    """
    assignment = snapshot["directives"]["assignment"]
    rows = []
    for robot in snapshot["robots"]:
        key = str(robot["id"])
        state = robot_state(robot)
        tone = "" if silent_s else f" {robot_tone(robot)}"
        targets = " ".join(f"T{t}" for t in assignment.get(key, ())) or "–"
        heard = _age(robot["state_age_s"], silent_s)
        speed = "–" if robot["velocity"] is None else f"{math.hypot(*robot['velocity']):.2f}"
        rows.append(
            f'<tr data-id="robot-{robot["id"]}"><th scope="row">D{robot["id"]}</th>'
            f'<td class="state{tone}"><i></i>{"was " if silent_s else ""}{state}</td>'
            f'<td class="wrap">{targets}{_card(decided.get(robot["id"]))}</td>'
            f'<td class="num">{speed}</td><td class="num">{heard}</td></tr>'
        )
    head = (
        '<th scope="col">Drone</th><th scope="col">State</th><th scope="col">Targets</th>'
        '<th scope="col" class="num">m/s</th>'
        '<th scope="col" class="num">Heard</th>'
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _card(decision: str | None) -> str:
    """Return a link to the decision behind a robot's targets."""
    if decision is None:
        return ""
    name = escape(decision)
    return (
        f' <button type="button" class="link" data-reveal="{name}"'
        f' title="The decision behind it">{name}</button>'
    )


def _age(age_s: float | None, silent_s: float) -> str:
    return "never" if age_s is None else f"{age_s + silent_s:.1f} s"
