from typing import Any

from console.ledger import MAX_STEPS, Credit, Ledger

NOTHING: dict[str, Any] = {
    "assignment": [], "weights": {}, "capacities": {}, "severities": {}, "pins_set": [],
    "pins_lifted": [], "replan": [],
}  # fmt: skip


def card(number: int, time_s: float = 10.0, **changes: Any) -> dict[str, Any]:
    return {
        "id": f"d{number}",
        "status": "adopted",
        "source": "operator",
        "author": "ada",
        "time_s": time_s,
        "decided_s": time_s,
        "changes": NOTHING | changes,
    }


def event(kind: str, data: dict[str, Any], time_s: float = 12.0) -> dict[str, Any]:
    return {"kind": kind, "time_s": time_s, "text": "", "data": data}


def test_pins_capacities_and_severities_have_authors() -> None:
    ledger = Ledger()
    ledger.note_card(card(1, pins_set=[{"id": "keep"}], capacities={"21": [2, 3]}))
    ledger.note_event(event("decision", {"decision": card(2, 20.0, severities={"s1": [1, 2]})}))
    assert ledger.pin("keep") == Credit("ada", 10.0)
    assert ledger.capacity(21) == Credit("ada", 10.0)
    assert ledger.severity("s1") == Credit("ada", 20.0)
    assert ledger.pin("other") is ledger.capacity(26) is ledger.severity("c1") is None


def test_what_did_not_go_into_force_tells_nothing() -> None:
    ledger = Ledger()
    for status in ("refused", "pending"):
        ledger.note_card(card(1, pins_set=[{"id": "keep"}]) | {"status": status})
    assert ledger.pin("keep") is None


def test_a_model_is_named_as_a_model_whatever_it_calls_itself() -> None:
    ledger = Ledger()
    said = card(1, weights={"tracking": [10.0, 20.0]}) | {"source": "action_llm", "author": "ada"}
    ledger.note_card(said)
    assert ledger.weight_steps(100.0)[0].credit.who == "the action model"


def test_weights_change_in_the_order_of_their_decisions_and_not_before_them() -> None:
    ledger = Ledger()
    ledger.take(
        [
            card(2, 30.0, weights={"control": [1.0, 2.0]}),
            card(1, 5.0, weights={"control": [3.0, 1.0]}),
        ],
        [],
    )
    assert [step.after["control"] for step in ledger.weight_steps(100.0)] == [1.0, 2.0]
    assert [step.after["control"] for step in ledger.weight_steps(10.0)] == [1.0]


def test_a_card_that_comes_again_counts_once() -> None:
    ledger = Ledger()
    for _ in range(3):
        ledger.note_card(card(1, weights={"control": [1.0, 2.0]}))
    assert len(ledger.weight_steps(100.0)) == 1


def test_the_past_is_bounded() -> None:
    ledger = Ledger()
    for number in range(MAX_STEPS + 50):
        ledger.note_card(card(number, float(number), weights={"control": [1.0, 2.0]}))
    steps = ledger.weight_steps(1e9)
    assert len(steps) == MAX_STEPS
    assert steps[0].credit.time_s == 50.0


def test_zones_are_found_drawn_or_known_from_the_start() -> None:
    ledger = Ledger()
    hit = {"robot": 21, "kind": "sensing", "zone": "s1"}
    ledger.note_event(event("attack", hit))
    assert ledger.zone("s1") is None
    ledger.note_event(event("attack", hit | {"zone": "s2", "new": True}))
    ledger.note_event(
        event("directives", {"what": "zone", "zone": "h1", "did": "drew", "author": "ada"})
    )
    assert ledger.zone("s2") == ("found by an attack on D21", 12.0)
    assert ledger.zone("h1") == ("drawn by ada", 12.0)


def test_a_card_of_an_older_recording_tells_what_it_has() -> None:
    ledger = Ledger()
    ledger.take([{"id": "d1", "status": "adopted", "changes": {"capacities": {"21": [2, 3]}}}], [])
    ledger.note_card({"id": "d2", "status": "adopted"})
    assert ledger.capacity(21) == Credit("an operator", 0.0)
