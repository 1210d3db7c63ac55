"""Decision cards: what each proposal changes, on what grounds, with what verdict and effect."""

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any, Final

from nicegui import ui

from console.board import Facts
from console.panel import Desk, Panel
from console.render import WEIGHT_WORDS, Json, clock, escape

CARDS_LOOKED_AT = 200
CARDS_SHOWN = 40
QUIET_SHOWN = 20
"""Of the cards that change nothing only the newest are worth their place."""

LOOP_WORDS = {
    "task": "Task model",
    "action": "Action model",
    "solver": "Assignment solver",
}
REFUSER_WORDS = {
    "no_answer": "No answer:",
    "parsing": "Unreadable:",
    "verification": "Stopped by verification:",
    "gate": "Stopped by the gate:",
    "timeout": "Expired:",
}
JUDGEMENT_WORDS = {
    "unchanged": "Asks for what is in force.",
    "better": "Predicted better.",
    "not_worse": "Predicted not worse than the margin.",
    "clearly_worse": "Predicted clearly worse.",
    "unjudged": "Not predicted.",
}


class DecisionsPanel(Panel):
    """The newest cards, each an element of its own, so that what is open in one stays open."""

    styles = ("decisions.css",)
    scripts = ("decisions.js",)

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the cards worth showing by name, the newest first."""
        mission = facts.mission.id
        cards = facts.service.newest_decisions(mission, CARDS_LOOKED_AT)
        return {f"decision:{mission}:{c['id']}": card(c, mission) for c in worth_showing(cards)}

    def __init__(self, desk: Desk) -> None:
        super().__init__(desk)
        self._cards: dict[str, ui.html] = {}

    def build(self) -> None:
        """Make the list, and the choice of what it shows."""
        ui.html(_FILTER, sanitize=False).classes("decision-filter")
        self._list = ui.element("div").classes("scroll decisions").props("data-show=changes")
        self._arrange()

    def refresh(self) -> None:
        """Put new cards on top, redraw those that changed, drop those that are too old."""
        self._arrange()

    def _arrange(self) -> None:
        drawn = {
            name: content
            for name, content in self.desk.board.panels.items()
            if name.startswith("decision:")
        }
        for name in self._cards.keys() - drawn.keys():
            self._cards.pop(name).delete()
        for name, content in reversed(drawn.items()):
            shown = self._cards.get(name)
            if shown is None:
                with self._list:
                    shown = ui.html(content, sanitize=False)
                shown.move(target_index=0)
                self._cards[name] = shown
            elif shown.content != content:
                shown.set_content(content)


_FILTER = """
<button type="button" class="plain" data-filter="changes" aria-pressed="true">Changes</button>
<button type="button" class="plain" data-filter="all" aria-pressed="false">All</button>
"""


_BLANK: Final[Json] = {
    "id": "?", "status": "", "changed": False, "changes": {}, "loop": "", "author": "",
    "feedback": "", "refused_by": "", "reasons": [], "comments": [], "facts": [], "tries": 0,
}  # fmt: skip
_CHANGES: Final[Json] = {
    "assignment": [], "weights": {}, "capacities": {}, "severities": {},
    "pins_set": [], "pins_lifted": [], "replan": [],
}  # fmt: skip
_OPTIONAL: Final[dict[str, Json]] = {
    "gate": dict.fromkeys(("mode", "judgement", "reason"), "")
    | dict.fromkeys(("difference_m2", "horizon_s", "margin_m2")),
    "effect": dict.fromkeys(("predicted_merit_m2", "realised_merit_m2", "from_s", "until_s"))
    | {"overlapped_by": []},
    "approval": {"approved": None, "by": "somebody"},
    "verification": {"accepted": False, "violations": []},
}


def worth_showing(newest_first: Iterable[Json]) -> list[Json]:
    """Return the cards to show, newest first: those that change nothing only while they are new."""

    def worthy() -> Iterator[Json]:
        for number, each in enumerate(newest_first):
            if number < QUIET_SHOWN or not is_quiet(whole(each)):
                yield each

    return list(islice(worthy(), CARDS_SHOWN))


def whole(decision: Json) -> Json:
    """Return a decision with every field that a card looks at; blank are those it lacks."""
    found = {name: _known(decision, name, blank) for name, blank in _BLANK.items()}
    found["changes"] = {n: _known(found["changes"], n, blank) for n, blank in _CHANGES.items()}
    for name, blanks in _OPTIONAL.items():
        part = decision.get(name)
        found[name] = None if part is None else blanks | part
    return decision | found


def _known(part: Json, name: str, blank: Any) -> Any:
    value = part.get(name)
    return blank if value is None else value


def is_quiet(decision: Json) -> bool:
    """Tell whether a decision asked for nothing new, and nobody was refused anything."""
    return bool(decision["status"] == "adopted" and not decision["changed"])


def state_of(decision: Json) -> tuple[str, str]:
    """Return the CSS class and the words of where a decision stands."""
    status = decision["status"]
    if status == "pending":
        return "waiting", "Waiting"
    if status not in {"adopted", "refused"}:
        return "unchanged", "Unknown"
    if status == "refused":
        if decision["refused_by"] == "timeout":
            return "expired", "Expired"
        return "refused", "Refused"
    if not decision["changed"]:
        return "unchanged", "No change"
    gate = decision["gate"]
    shadow = gate is not None and gate["mode"] == "shadow"
    return ("shadow", "Applied · shadow") if shadow else ("applied", "Applied")


def changes(decision: Json) -> list[str]:
    """Return what a decision changes, in words, a sentence each."""
    made = decision["changes"]
    words = [_row(row) for row in made["assignment"]]
    words += [
        f"{WEIGHT_WORDS.get(name, name)} {old:g} → {new:g}."
        for name, (old, new) in made["weights"].items()
    ]
    words += [
        f"Capacity of drone {robot}: {new} instead of {old}."
        for robot, (old, new) in made["capacities"].items()
    ]
    words += [
        f"Severity of zone {zone}: {new:g} instead of {old:g}."
        for zone, (old, new) in made["severities"].items()
    ]
    words += [
        f"Drone {pin['robot']} and target {pin['target']} "
        f"{'kept apart' if pin['forbids'] else 'pinned'}."
        for pin in made["pins_set"]
    ]
    words += [f"Pin {pin} lifted." for pin in made["pins_lifted"]]
    words += [f"Drone {robot} plans afresh." for robot in made["replan"]]
    return words


def card(decision: Json, mission: str) -> str:
    """Return one card; of one that lacks fields, such as a recording's, what is there."""
    decision = whole(decision)
    tone, state = state_of(decision)
    quiet = " quiet" if is_quiet(decision) else ""
    name = escape(decision["id"])
    who = LOOP_WORDS.get(decision["loop"]) or escape(decision["author"].capitalize())
    return (
        f'<article class="decision {tone}{quiet}" data-id="{name}" tabindex="-1">'
        f'<header><span class="chip">{state}</span><b>{who}</b>'
        f"<span>{name} · {clock(decision.get('time_s'))}</span></header>"
        f"{what(decision)}{_approval(decision)}{_refusal(decision)}{prediction(decision)}"
        f"{_effect(decision)}{_links(decision)}{_evidence(decision, mission)}</article>"
    )


def what(decision: Json) -> str:
    """Return what is asked for, and the asker's own words."""
    lines = "".join(f"<p>{escape(words)}</p>" for words in changes(decision))
    said = decision["feedback"]
    return f'<div class="what">{lines}</div>' + (f"<q>{escape(said)}</q>" if said else "")


def prediction(decision: Json) -> str:
    """Return what the gate predicts, nothing where nothing changes."""
    gate = decision["gate"]
    if gate is None or not decision["changed"] or gate["mode"] == "off":
        return ""
    words = JUDGEMENT_WORDS.get(gate["judgement"], escape(gate["judgement"]))
    figure = ""
    if gate["difference_m2"] is not None:
        figure = (
            f"<b>{gate['difference_m2']:+.3f} m²</b> over {_figure(gate['horizon_s'], 'g')} s"
            f" <small>margin {_figure(gate['margin_m2'], '.3f')}</small>"
        )
    tone = escape(gate["judgement"])
    return f'<p class="prediction {tone}"><span>{words}</span> {figure}</p>'


def _row(row: Json) -> str:
    gains = ", ".join(str(target) for target in row["gains"])
    loses = ", ".join(str(target) for target in row["loses"])
    plural = "s" if len(row["gains"] or row["loses"]) > 1 else ""
    if gains and loses:
        return f"Drone {row['robot']}: target{plural} {gains} instead of {loses}."
    if gains:
        return f"Drone {row['robot']}: target{plural} {gains} as well."
    return f"Drone {row['robot']}: gives up target{plural} {loses}."


def _approval(decision: Json) -> str:
    approval = decision["approval"]
    if approval is None or approval["approved"] is None:
        return ""
    verb = "Approved" if approval["approved"] else "Refused"
    return f'<p class="approval">{verb} by <b>{escape(approval["by"])}</b>.</p>'


def _refusal(decision: Json) -> str:
    if decision["status"] != "refused" or decision["refused_by"] == "person":
        return ""  # the person is named already
    by = REFUSER_WORDS.get(decision["refused_by"], "Refused:")
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in decision["reasons"])
    return f'<div class="reasons"><span>{by}</span><ul>{reasons}</ul></div>'


def _effect(decision: Json) -> str:
    effect = decision["effect"]
    if effect is None:
        return ""
    realised = effect["realised_merit_m2"]
    became = f"<b>{realised:.3f} m²</b>" if realised is not None else "<span>still open</span>"
    others = ", ".join(escape(other) for other in effect["overlapped_by"])
    mixed = f"<small>mixed with {others}</small>" if others else ""
    until = f"{clock(effect['from_s'])} to {clock(effect['until_s'])}"
    return (
        f'<dl class="effect" title="Merit per second, less is better; {until}">'
        f"<dt>Predicted</dt><dd><b>{_figure(effect['predicted_merit_m2'], '.3f')} m²</b></dd>"
        f"<dt>Became</dt><dd>{became}</dd>{mixed}</dl>"
    )


def _figure(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _links(decision: Json) -> str:
    made = decision["changes"]
    robots = dict.fromkeys(
        [row["robot"] for row in made["assignment"]]
        + [int(robot) for robot in made["capacities"]]
        + list(made["replan"])
    )
    links = [
        f'<button type="button" class="link" data-reveal="robot-{robot}">D{robot}</button>'
        for robot in robots
    ]
    links += [
        f'<button type="button" class="link" data-reveal="{escape(comment)}">'
        f"comment {escape(comment)}</button>"
        for comment in decision["comments"]
    ]
    return f'<p class="links">{" ".join(links)}</p>' if links else ""


def _evidence(decision: Json, mission: str) -> str:
    name = escape(f"{mission}/{decision['id']}")
    facts = "".join(f"<li>{escape(fact['text'])}</li>" for fact in decision["facts"])
    tries = decision["tries"]
    many = "" if tries <= 1 else f" It took {tries} tries."
    exchange = ""
    if decision["loop"] in ("task", "action"):
        exchange = (
            f'<details data-keep="raw/{name}" data-exchange="{name}">'
            '<summary>Prompt and answer</summary><div class="exchange"></div></details>'
        )
    return (
        f'<details data-keep="facts/{name}"><summary>Evidence and verdict'
        f" ({len(decision['facts'])})</summary><ul>{facts}</ul>"
        f"<p>{_verdict(decision)}{many}</p>{_reason(decision)}</details>{exchange}"
    )


def _verdict(decision: Json) -> str:
    verdict = decision["verification"]
    if verdict is None:
        return "There was nothing to verify."
    if verdict["accepted"]:
        return "Verification: may be done."
    violations = "".join(f"<li>{escape(each)}</li>" for each in verdict["violations"])
    return f"Verification: must not be done.</p><ul>{violations}</ul><p>"


def _reason(decision: Json) -> str:
    gate = decision["gate"]
    return "" if gate is None or not gate["reason"] else f"<p>Gate: {escape(gate['reason'])}</p>"
