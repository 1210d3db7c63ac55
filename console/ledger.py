"""Who asked for what stands now: folded from decision cards and events, for tooltips and history.

A snapshot says what is in force; who brought it about stands on the decision cards and in the
events. Both may come again (a card grows, a replay goes back): the newest word on an id counts.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, TypeVar

from console.cards import whole

Json = dict[str, Any]
_Known = TypeVar("_Known")

MAX_STEPS = 400
"""Changes of the weights that are remembered."""

MAX_KNOWN = 2000
"""Pins, zones and capacities whose origin is remembered."""

MODEL_WORDS = {
    "task_llm": "the task model",
    "action_llm": "the action model",
    "exact": "our own solver",
    "repair": "the repair",
}


@dataclass(frozen=True, slots=True)
class Credit:
    """Who did something, and when (mission time, seconds)."""

    who: str
    time_s: float


@dataclass(frozen=True, slots=True)
class WeightStep:
    """One change of the weights: the new values of those that changed."""

    credit: Credit
    before: dict[str, float]
    after: dict[str, float]


@dataclass(slots=True)
class Ledger:
    """What one mission's cards and events say about authorship."""

    _pins: dict[str, Credit] = field(default_factory=dict)
    _capacities: dict[str, Credit] = field(default_factory=dict)
    _severities: dict[str, Credit] = field(default_factory=dict)
    _zones: dict[str, tuple[str, float]] = field(default_factory=dict)
    _steps: dict[str, WeightStep] = field(default_factory=dict)

    def take(self, cards: Iterable[Json], events: Iterable[Json]) -> None:
        """Take what is known already."""
        for card in cards:
            self.note_card(card)
        for event in events:
            self.note_event(event)

    def note_event(self, event: Json) -> None:
        """Take one event of the stream."""
        data = event["data"]
        if event["kind"] == "decision":
            self.note_card(data["decision"])
        elif event["kind"] == "attack" and data.get("new"):
            words = f"found by an attack on D{data['robot']}"
            _keep(self._zones, data["zone"], (words, event["time_s"]))
        elif data.get("what") == "zone" and data.get("did") == "drew":
            _keep(self._zones, data["zone"], (f"drawn by {data['author']}", event["time_s"]))

    def note_card(self, card: Json) -> None:
        """Take one decision card; those that did not go into force tell nothing."""
        if card.get("status") != "adopted":
            return
        changes = whole(card)["changes"]
        who = MODEL_WORDS.get(card.get("source", "")) or card.get("author") or "an operator"
        times = (card.get("decided_s"), card.get("time_s"), 0.0)
        time_s = next(each for each in times if each is not None)
        credit = Credit(who, time_s)
        for pin in changes["pins_set"]:
            _keep(self._pins, pin["id"], credit)
        for robot in changes["capacities"]:
            _keep(self._capacities, robot, credit)
        for zone in changes["severities"]:
            _keep(self._severities, zone, credit)
        if changes["weights"]:
            before = {name: pair[0] for name, pair in changes["weights"].items()}
            after = {name: pair[1] for name, pair in changes["weights"].items()}
            self._steps[card["id"]] = WeightStep(credit, before, after)
            while len(self._steps) > MAX_STEPS:
                del self._steps[next(iter(self._steps))]

    def pin(self, pin_id: str) -> Credit | None:
        """Return who set a pin, None where that is not known."""
        return self._pins.get(pin_id)

    def capacity(self, robot_id: int) -> Credit | None:
        """Return who set a robot's capacity; None: it is the scenario's."""
        return self._capacities.get(str(robot_id))

    def severity(self, zone_id: str) -> Credit | None:
        """Return who set a zone's severity; None: nobody has."""
        return self._severities.get(zone_id)

    def zone(self, zone_id: str) -> tuple[str, float] | None:
        """Return how a zone became known, in words, and when; None: known from the start."""
        return self._zones.get(zone_id)

    def weight_steps(self, until_s: float) -> list[WeightStep]:
        """Return the changes of the weights up to a mission time, oldest first."""
        past = [step for step in self._steps.values() if step.credit.time_s <= until_s]
        return sorted(past, key=lambda step: step.credit.time_s)


def _keep(known: dict[str, _Known], key: str, value: _Known) -> None:
    """Remember the newest word; beyond the limit the oldest are forgotten."""
    known.pop(key, None)
    known[key] = value
    while len(known) > MAX_KNOWN:
        del known[next(iter(known))]
