"""Decision cards: what each proposal changes, on what grounds, with what verdict and effect."""

from collections.abc import Iterator, Sequence
from itertools import groupby

from nicegui import ui

from console.board import Facts
from console.cards import is_quiet, whole
from console.panel import Desk, Panel
from console.render import WEIGHT_WORDS, Json, clock, escape

CARDS_LOOKED_AT = 200
CARDS_SHOWN = 40
QUIET_SHOWN = 20
"""Of the cards that change nothing only the newest are worth a place of their own."""

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
        """Return the cards worth showing by name, the newest first, and lines for the others."""
        mission = facts.mission.id
        cards = facts.service.newest_decisions(mission, CARDS_LOOKED_AT)
        return {f"decision:{mission}:{name}": html for name, html in listing(cards, mission)}

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
        for place, (name, content) in enumerate(drawn.items()):
            shown = self._cards.get(name)
            if shown is None:
                with self._list:
                    shown = ui.html(content, sanitize=False)
                shown.move(target_index=place)  # all before it stand in their places already
                self._cards[name] = shown
            elif shown.content != content:
                shown.set_content(content)


_FILTER = """
<button type="button" class="plain" data-filter="changes" aria-pressed="true">Changes</button>
<button type="button" class="plain" data-filter="all" aria-pressed="false">All</button>
"""


def listing(newest_first: Sequence[Json], mission: str) -> Iterator[tuple[str, str]]:
    """Yield name and HTML of what is listed, the newest first.

    Cards in a row that change nothing are told in one line as well: who looks at changes alone
    sees that models answer, how often and when. Each has a card of its own only while it is new.
    """
    seen = shown = 0
    for quiet, run in groupby(newest_first, is_quiet):
        cards = list(run)
        fresh = max(0, QUIET_SHOWN - seen)
        seen += len(cards)
        if shown == CARDS_SHOWN:
            return
        if quiet:
            # Named after the older card below it, so that it keeps its place while it grows.
            below = newest_first[seen].get("id") if seen < len(newest_first) else "nothing"
            yield f"above:{below}", quiet_line(cards, older=CARDS_LOOKED_AT - seen)
            cards = cards[:fresh]
        for each in cards[: CARDS_SHOWN - shown]:
            shown += 1
            yield str(each.get("id", "?")), card(each, mission)


def quiet_line(newest_first: Sequence[Json], older: int) -> str:
    """Return one line for cards in a row that change nothing: how many, from when to when.

    `older` is how many cards before them could have been looked at: with none there may be more.
    """
    newest, oldest = (clock(each.get("time_s")) for each in (newest_first[0], newest_first[-1]))
    count = len(newest_first)
    times = ("once" if count == 1 else f"{count} times") + ("" if older > 0 else " or more")
    when = newest if count == 1 else f"{oldest} to {newest}"
    return f'<p class="unchanging"><span>No change, {times}</span><span>{when}</span></p>'


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
