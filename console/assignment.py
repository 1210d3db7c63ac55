"""The assignment as HTML: a matrix whose cells are buttons, or a list for large teams.

A cell is tapped as `pair:ROBOT:TARGET`, a capacity as `capacity:ROBOT`. What a browser sends back
is read by `tapped`, which believes none of it.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from console.ledger import Ledger
from console.render import clock, escape, robot_tone, since, target_tone
from console.steering import PairState, binding, state_of

Json = dict[str, Any]
Pins = dict[int, dict[int, list[Json]]]

WIDE_MATRIX = 16
"""Beyond so many targets the matrix becomes a list: cells would be too small to read."""

NEXT_WORDS = {
    PairState.FREE: "press to pin",
    PairState.PINNED: "press to keep apart",
    PairState.FORBIDDEN: "press to set free",
}
_PAIR = re.compile(r"pair:([0-9]{1,10}):([0-9]{1,10})")
_CAPACITY = re.compile(r"capacity:([0-9]{1,10})")
_MARKS = {PairState.FREE: "", PairState.PINNED: " pin", PairState.FORBIDDEN: " forbid"}


def matrix(snapshot: Json, ledger: Ledger) -> str:
    """Return the assignment: a matrix, or a list where it would be too wide."""
    if len(snapshot["targets"]) > WIDE_MATRIX:
        return _list(snapshot, ledger)
    head = "".join(
        f'<th scope="col" class="{target_tone(t)}" title="{escape(t["status"])}">T{t["id"]}</th>'
        for t in snapshot["targets"]
    )
    target_ids = [target["id"] for target in snapshot["targets"]]
    pins = pins_by_pair(snapshot)
    rows = []
    for robot in snapshot["robots"]:
        cells = "".join(
            f'<td class="{cell.tone}">{cell.button(ledger, "")}</td>'
            for cell in _cells(snapshot, robot, target_ids, pins)
        )
        rows.append(
            f'<tr><th scope="row">D{robot["id"]}</th>{cells}'
            f"{_capacity(snapshot, robot['id'], ledger)}</tr>"
        )
    return (
        f'<table class="matrix"><thead><tr><td></td>{head}'
        '<th scope="col" title="most targets at once">max</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def tapped(value: str) -> tuple[str, tuple[int, ...]] | None:
    """Return what was tapped, `pair` or `capacity`, and its ids; None for what is neither."""
    if found := _PAIR.fullmatch(value):
        return "pair", (int(found[1]), int(found[2]))
    if found := _CAPACITY.fullmatch(value):
        return "capacity", (int(found[1]),)
    return None


def note(snapshot: Json) -> str:
    """Return who asked for the assignment, and since when it stands."""
    return since(snapshot, "assignment")


def pins_by_pair(snapshot: Json) -> Pins:
    """Return the pins by robot and target, each pair's in the order they were set."""
    found: Pins = {}
    for pin in snapshot["directives"]["pins"]:
        found.setdefault(pin["robot"], {}).setdefault(pin["target"], []).append(pin)
    return found


def pair_words(pins: list[Json], ledger: Ledger) -> str:
    """Return what people have said of a pair: what, by whom, until when; "" for nothing."""
    if not pins:
        return ""
    pin = binding(pins)
    what = "kept apart" if pin["forbids"] else "pinned"
    credit = ledger.pin(pin["id"])
    if pin["comment"] is not None:
        by = f" by comment {pin['comment']}"
    elif credit is not None:
        by = f" by {credit.who} at {clock(credit.time_s)}"
    else:
        by = " by an operator"
    until = pin["expires_s"]
    return f"{what}{by} {'for good' if until is None else f'until {clock(until)}'}"


@dataclass(frozen=True, slots=True)
class _Cell:
    """One robot and one target."""

    robot: Json
    target_id: int
    assigned: bool
    pins: list[Json]

    @property
    def tone(self) -> str:
        """The CSS classes of the cell."""
        on = " on" if self.assigned else ""
        return f"cell{on}{_MARKS[state_of(self.pins)]} {robot_tone(self.robot)}"

    def button(self, ledger: Ledger, text: str) -> str:
        """Return the button that turns the pair on."""
        said = pair_words(self.pins, ledger)
        robot_id = self.robot["id"]
        words = (
            f"robot {robot_id}, target {self.target_id}: "
            f"{'assigned' if self.assigned else 'not assigned'}"
            f"{f', {said}' if said else ''}; {NEXT_WORDS[state_of(self.pins)]}"
        )
        return (
            f'<button type="button" data-tap="pair:{robot_id}:{self.target_id}"'
            f' title="{escape(words)}" aria-label="{escape(words)}"><i></i>{text}</button>'
        )


def _cells(snapshot: Json, robot: Json, target_ids: Iterable[int], pins: Pins) -> list[_Cell]:
    """Return the cells of one robot with some targets."""
    own = set(snapshot["directives"]["assignment"].get(str(robot["id"]), ()))
    spoken = pins.get(robot["id"], {})
    return [
        _Cell(robot, target_id, target_id in own, spoken.get(target_id, []))
        for target_id in target_ids
    ]


def _capacity(snapshot: Json, robot_id: int, ledger: Ledger) -> str:
    most = snapshot["directives"]["capacities"].get(str(robot_id), "–")
    credit = ledger.capacity(robot_id)
    by = "by the scenario" if credit is None else f"by {credit.who} at {clock(credit.time_s)}"
    words = f"robot {robot_id}: at most {most} targets, {by}; press to change"
    return (
        f'<td class="capacity"><button type="button" data-tap="capacity:{robot_id}"'
        f' title="{escape(words)}" aria-label="{escape(words)}">{most}</button></td>'
    )


def _list(snapshot: Json, ledger: Ledger) -> str:
    """Return a row per robot with its targets, and those it must not have."""
    rows = []
    pins = pins_by_pair(snapshot)
    for robot in snapshot["robots"]:
        own = snapshot["directives"]["assignment"].get(str(robot["id"]), ())
        spoken = pins.get(robot["id"], {})
        chips = "".join(
            f'<span class="{cell.tone}">{cell.button(ledger, f"T{cell.target_id}")}</span>'
            for cell in _cells(snapshot, robot, sorted({*own, *spoken}), pins)
        )
        rows.append(
            f'<tr><th scope="row">D{robot["id"]}</th><td class="wrap pairs">{chips or "–"}</td>'
            f"{_capacity(snapshot, robot['id'], ledger)}</tr>"
        )
    return (
        '<table class="matrix list"><thead><tr><td></td><th scope="col">targets</th>'
        '<th scope="col" title="most targets at once">max</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
    )
