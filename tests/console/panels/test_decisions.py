import re
from dataclasses import replace
from typing import Any

import pytest

from console.panels import approvals, decisions
from server.gate.decisions import Changes, Decision, Refuser, RowChange, Status
from server.gate.encoding import decision_object
from server.mission.setup import GateMode
from solver.directives import Pairing, Pin, Verdict
from solver.observations import Comment
from tests.console.reading import EVIL, words
from tests.server.scripted_deciding import PROPOSED, adopted, override_card, proposed, refused
from tests.server.scripted_directing import NOTHING

COMMENT = Comment("c1", "Focus on 122.", 60.0, 120.0, "ada")


def made(mode: GateMode = GateMode.AUTO) -> Decision:
    return proposed(7, COMMENT, 63.2, mode)


def told(decision: Decision) -> dict[str, Any]:
    return decision_object(decision)


def test_a_card_tells_what_changes_on_what_grounds_and_with_what_effect() -> None:
    html = decisions.card(told(made()), "m1")
    text = words(html)
    assert text.startswith("Applied Task model d7 · 1:03.2 Drone 21: target 122 instead of 125.")
    assert "Drone 21 looks after target 122 from now on." in text
    assert "Predicted better. -0.142 m² over 5 s margin 0.050" in text
    assert "Predicted 0.480 m² Became still open" in text
    assert "Evidence and verdict (3)" in text
    assert "Operator said: Focus on 122." in text
    assert "Verification: may be done." in text
    assert "Gate: The merit is predicted 0.142 m² better over 5 s." in text


def test_the_realised_effect_stands_beside_the_predicted_one() -> None:
    decision = made()
    assert decision.effect is not None
    effect = replace(
        decision.effect, realised=PROPOSED, realised_merit=0.51, overlapped_by=("d8", "d9")
    )
    text = words(decisions.card(told(replace(decision, effect=effect)), "m1"))
    assert "Predicted 0.480 m² Became 0.510 m² mixed with d8, d9" in text


def test_comments_robots_and_the_exchange_are_linked_and_not_sent() -> None:
    html = decisions.card(told(made()), "m1")
    assert re.findall('data-reveal="([^"]+)"', html) == ["robot-21", "robot-26", "c1"]
    assert 'data-id="d7"' in html
    assert 'data-exchange="m1/d7"' in html
    assert "You assign targets" not in html
    person = override_card(8, 1.0, "ada", NOTHING | {"replan": [21]})
    assert "data-exchange" not in decisions.card(person, "m1")  # nobody was prompted


def test_every_change_has_its_words() -> None:
    pins = (Pin("p1", Pairing(21, 122), None, None), Pin("p2", Pairing(26, 125), None, None, True))
    changes = Changes(
        assignment=(RowChange(21, (122, 123), ()), RowChange(26, (), (125,))),
        weights=(("tracking", 10.0, 12.5),),
        capacities=((21, 2, 3),),
        severities=(("s1", 1.0, 2.0),),
        pins_set=pins,
        pins_lifted=("keep",),
        replan=(34,),
    )
    assert decisions.changes(told(replace(made(), changes=changes))) == [
        "Drone 21: targets 122, 123 as well.",
        "Drone 26: gives up target 125.",
        "Tracking 10 → 12.5.",
        "Capacity of drone 21: 3 instead of 2.",
        "Severity of zone s1: 2 instead of 1.",
        "Drone 21 and target 122 pinned.",
        "Drone 26 and target 125 kept apart.",
        "Pin keep lifted.",
        "Drone 34 plans afresh.",
    ]


def test_states_have_their_words() -> None:
    waiting = made(GateMode.CONFIRM)
    late = replace(refused(waiting, 70.0, "ada"), refused_by=Refuser.TIMEOUT)
    same = replace(made(), changes=Changes())
    found = [
        decisions.state_of(told(each))[1]
        for each in (
            waiting,
            made(),
            made(GateMode.SHADOW),
            refused(waiting, 1.0, "ada"),
            late,
            same,
        )
    ]
    assert found == ["Waiting", "Applied", "Applied · shadow", "Refused", "Expired", "No change"]


def test_after_an_approval_the_card_says_who() -> None:
    waiting = made(GateMode.CONFIRM)
    assert "by" not in words(decisions.card(told(waiting), "m1")).split("Evidence")[0]
    yes = words(decisions.card(told(adopted(waiting, 65.0, "ada")), "m1"))
    no = words(decisions.card(told(refused(waiting, 65.0, "bob")), "m1"))
    assert "Approved by ada ." in yes
    assert "Refused by bob ." in no
    assert "Bob refused it." not in no  # it is said already
    late = replace(refused(waiting, 65.0, "bob"), refused_by=Refuser.TIMEOUT, approval=None)
    assert "Expired: Bob refused it." in words(decisions.card(told(late), "m1"))


def test_violations_are_told() -> None:
    wrong = replace(
        made(),
        status=Status.REFUSED,
        refused_by=Refuser.VERIFICATION,
        reasons=("Drone 21 has 3 targets, capacity 2.",),
        verification=Verdict("p", ("Drone 21 has 3 targets, capacity 2.",)),
        gate=None,
        effect=None,
    )
    text = words(decisions.card(told(wrong), "m1"))
    assert "Stopped by verification: Drone 21 has 3 targets, capacity 2." in text
    assert "Verification: must not be done. Drone 21 has 3 targets, capacity 2." in text


def test_what_models_and_people_write_is_never_run() -> None:
    decision = made(GateMode.CONFIRM)
    evil = told(adopted(replace(decision, feedback=EVIL), 1.0, EVIL)) | {
        "author": EVIL,
        "comments": [EVIL],
        "reasons": [EVIL],
        "facts": [{"text": EVIL}],
    }
    evil["gate"]["reason"] = EVIL
    for each in (evil, evil | {"status": "refused", "loop": "people", "refused_by": EVIL}):
        html = decisions.card(each, EVIL) + approvals.waiting_card(each, 0.0)
        assert "<script>" not in html
        assert html.count("&lt;script&gt;") >= 5


def listed(*cards: dict[str, Any]) -> list[tuple[str, str]]:
    """What the list of some cards shows, the newest first: names and words."""
    found = decisions.listing(cards, "m1")
    return [(name, words(html).partition(" Evidence")[0]) for name, html in found]


def quiet(number: int) -> dict[str, Any]:
    same = replace(made(), changes=Changes())
    return told(same) | {"id": f"d{number}", "time_s": float(number)}


def loud(number: int) -> dict[str, Any]:
    return told(made()) | {"id": f"d{number}"}


def test_cards_that_change_nothing_go_first() -> None:
    cards = [*map(quiet, range(80, 50, -1)), *map(loud, range(50, 0, -1))]
    shown = [name for name, _ in listed(*cards) if not name.startswith("above:")]
    assert shown == [f"d{number}" for number in (*range(80, 60, -1), *range(50, 30, -1))]


def test_cards_in_a_row_that_change_nothing_are_told_in_one_line() -> None:
    cards = [quiet(9), loud(8), *map(quiet, (7, 6, 5)), loud(4), loud(3), quiet(2), quiet(1)]
    found = listed(*cards)
    assert [(name, text) for name, text in found if name.startswith("above:")] == [
        ("above:d8", "No change, once 0:09.0"),
        ("above:d4", "No change, 3 times 0:05.0 to 0:07.0"),
        ("above:nothing", "No change, 2 times 0:01.0 to 0:02.0"),
    ]
    assert [name for name, _ in found] == [
        *("above:d8", "d9", "d8", "above:d4", "d7", "d6", "d5", "d4", "d3"),
        *("above:nothing", "d2", "d1"),
    ]


def test_a_row_that_goes_back_beyond_what_is_looked_at_may_be_longer() -> None:
    cards = [loud(300), *map(quiet, range(299, 300 - decisions.CARDS_LOOKED_AT, -1))]
    assert "No change, 199 times or more 1:41.0 to 4:59.0" in dict(listed(*cards)).values()
    assert "No change, 198 times 1:42.0 to 4:59.0" in dict(listed(*cards[:-1])).values()


def test_what_waits_tells_its_price_and_the_time_that_is_left() -> None:
    html = approvals.waiting_card(told(made(GateMode.CONFIRM)), 83.3)
    assert words(html).startswith("Task model asks d7 40 s left Drone 21: target 122 instead of")
    assert "-0.142 m² over 5 s" in words(html)
    assert re.findall('data-tap="([^"]+)"', html) == ["approve:d7", "refuse:d7"]


@pytest.mark.parametrize("missing", [None, *decision_object(made())])
def test_a_card_that_lacks_a_field_shows_what_is_there(missing: str | None) -> None:
    full = told(made())
    card = {name: value for name, value in full.items() if name != missing}
    assert card.get("id", "?") in dict(decisions.listing([card], "m1"))
    text = words(decisions.card(card, "m1"))
    assert missing == "id" or "d7" in text
    assert missing == "changes" or "Drone 21: target 122 instead of 125." in text


@pytest.mark.parametrize("part", ["changes", "gate", "effect", "verification"])
def test_a_card_with_an_empty_part_shows_the_others(part: str) -> None:
    text = words(decisions.card(told(made()) | {part: {}}, "m1"))
    assert "Operator said: Focus on 122." in text


def test_of_a_card_with_a_name_alone_the_name_is_shown() -> None:
    assert words(decisions.card({"id": "d9"}, "m1")).startswith("Unknown d9 · –:–– ")
