from dataclasses import replace

import pytest

from server.live.news import Item, news
from solver.arrays import frozen_bool
from solver.directives import CommentVerdict, Pairing, Source, Weights
from solver.observations import Attack, Comment, HoldState, Link
from solver.problem import Rung
from solver.snapshot import CommentReceipt, Guidance, Snapshot, SolveSummary, TrackStatus
from solver.zones import ZoneKind
from tests.server.scripted import FOUND, HIDDEN, directives, snapshot


def told(before: Snapshot | None, after: Snapshot) -> list[tuple[str, str, str]]:
    items: list[Item] = list(news(before, after))
    return [(item.kind.value, item.severity.value, item.text) for item in items]


def test_nothing_new_is_no_news() -> None:
    assert told(snapshot(1.0), snapshot(1.1)) == []


@pytest.mark.parametrize(
    ("kind", "zone", "text"),
    [
        (ZoneKind.SENSING, FOUND[0], "Robot 21 was blinded by zone s1."),
        (
            ZoneKind.SENSING,
            HIDDEN[0],
            "Robot 21 was blinded by zone s2, which nobody knew before.",
        ),
        (ZoneKind.COMMUNICATION, None, "Robot 21 was cut off by an unknown zone."),
    ],
)
def test_attacks_are_told_with_their_zone(kind, zone, text) -> None:  # type: ignore[no-untyped-def]
    after = snapshot(1.1, attacks=(Attack(21, kind, zone, 1.0),))
    assert told(snapshot(1.0), after) == [("attack", "warning", text)]


def test_links_are_told_by_their_gravity() -> None:
    before = snapshot(1.0)
    links = (Link.LOST, Link.JAMMED, Link.CONNECTED, Link.CONNECTED)
    after = replace(before, robots=replace(before.robots, links=links))
    assert told(before, after) == [
        ("link", "alarm", "Robot 21 is lost."),
        ("link", "warning", "Robot 26 is silent but alive: communication failure."),
        ("link", "info", "Robot 31 is connected again."),
    ]


def test_a_robot_that_sees_again_is_told() -> None:
    before = snapshot(1.0)
    seeing = replace(before.robots, sensing_failed=frozen_bool([False] * 4))
    assert told(before, replace(before, robots=seeing)) == [
        ("recovery", "info", "Robot 26 sees again.")
    ]


def test_lost_and_found_targets_are_told() -> None:
    before = snapshot(1.0)
    gone = replace(before.tracks, status=(TrackStatus.DROPPED, *before.tracks.status[1:]))
    after = replace(before, tracks=gone)
    lost = "Target 121 is lost: nobody has seen it for too long."
    assert told(before, after) == [("alarm", "alarm", lost)]
    assert told(after, before) == [("recovery", "info", "Target 121 was found.")]


def test_an_assignment_is_told_robot_by_robot() -> None:
    before = directives()
    swapped = before.assignment - {Pairing(26, 122)} | {Pairing(21, 122)}
    after = replace(before, assignment=swapped, assignment_source=Source.TASK_LLM)
    by_robot = "robot 21 tracks 121, 122, 125; robot 26 tracks no target"
    assert told(snapshot(1.0, directives=before), snapshot(1.1, directives=after)) == [
        ("directives", "info", f"Assignment by the task model: {by_robot}.")
    ]


def test_weights_and_severities_are_told_with_both_values() -> None:
    before = directives()
    after = replace(
        before,
        weights=Weights(20.0, 0.05, 50.0, 50.0),
        severities=(("s1", 2.0),),
        weights_source=Source.ACTION_LLM,
    )
    text = "Weights by the action model: tracking 10 to 20, severity of zone s1 to 2."
    said = told(snapshot(1.0, directives=before), snapshot(1.1, directives=after))
    assert said == [("directives", "info", text)]


def test_comments_are_told_when_they_come_and_when_they_are_answered() -> None:
    comment = Comment("c1", "Focus on 122.", 1.0, 120.0)
    received = CommentReceipt(comment)
    applied = replace(received, task=CommentVerdict.APPLIED, task_reason="It is 21's now.")
    silent, said = snapshot(1.0), snapshot(1.1, receipts=(received,))
    assert told(silent, said) == [("comment", "info", "Operator: Focus on 122.")]
    answered = snapshot(1.2, receipts=(applied,))
    assert told(said, answered) == [("comment", "info", "Comment c1 applied: It is 21's now.")]
    closed = snapshot(130.0, closed=(replace(applied, expired=True),))
    assert told(answered, closed) == []


def test_a_comment_is_told_with_the_reason_of_the_loop_that_applied_it() -> None:
    comment = Comment("c1", "Be careful.", 1.0, 120.0)
    noted = CommentReceipt(comment, CommentVerdict.NOTED, "Not mine.")
    applied = replace(noted, action=CommentVerdict.APPLIED, action_reason="Safety counts more.")
    before, after = snapshot(1.0, receipts=(noted,)), snapshot(1.1, receipts=(applied,))
    assert told(before, after) == [("comment", "info", "Comment c1 applied: Safety counts more.")]


def test_hold_guidance_and_a_failing_optimizer_are_told() -> None:
    before = snapshot(1.0)
    held = replace(before, hold=HoldState.HELD, guidance=Guidance.HOLD)
    assert told(before, held) == [("hold", "warning", "All robots hold.")]
    assert told(held, before) == [
        ("hold", "info", "The team flies again."),
        ("loop", "info", "The team is guided by the models."),
    ]
    stale = replace(before, guidance=Guidance.LAST_VALID)
    assert told(before, stale)[0][:2] == ("loop", "warning")
    braking = replace(before, solve=SolveSummary(Rung.BRAKE, 0.0, 0, 0.0))
    assert told(before, braking) == [
        ("alarm", "warning", "The optimizer found no new plan; the team flies on rung brake.")
    ]
    assert told(braking, braking) == []
