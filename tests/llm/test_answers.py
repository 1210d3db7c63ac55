import json
import math
import time
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from llm.answers import (
    ActionAnswer,
    AnswerError,
    SaidOfComment,
    TaskAnswer,
    is_refusal,
    read_action,
    read_task,
)
from solver.directives import CommentVerdict
from tests.llm.fuzzing import campaign

BOTH = {21: (122,), 26: (124,)}
Rows = dict[int, tuple[int, ...]]


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("Drone 21 should track Target 122.\nDrone 26 should track Target 124.", BOTH),
        ("Drone 21 should track Target 122 and Target 124.", {21: (122, 124)}),
        ("Drone 21 should track Targets 122 and 124.", {21: (122, 124)}),
        ("Drone 21 should track targets 122, 124, and 125.", {21: (122, 124, 125)}),
        ("1. Drone 21 should track Target 122.\n2. Drone 26 should track Target 124.", BOTH),
        ("1) Drone 21: Target 122\n2) Drone 26: Target 124", BOTH),
        ("- **Drone 21** will track **Target 122**\n- **Drone 26** will track Target 124", BOTH),
        ("  - Drone 21 -> 122\n  - Drone 26 -> 124", BOTH),
        ("Drone 21: 122, 124\nDrone 26: none", {21: (122, 124), 26: ()}),
        ("Drone 21: [122, 124]\nDrone 26: []", {21: (122, 124), 26: ()}),
        ("| Drone 21 | Target 122 |\n|---|---|\n| Drone 26 | Target 124 |", BOTH),
        ("Drone 21 should track no target.\nDrone 26: Target 124", {21: (), 26: (124,)}),
        ("Drone 21 stays idle. Drone 26 tracks Target 124.", {21: (), 26: (124,)}),
        ("Drone 21 should track Target 122 and Drone 26 should track Target 124.", BOTH),
        ("Drone 21 should track Target 122, Drone 26 Target 124.", {21: (122,)}),
        ("Drones 21 and 26 should both track Target 122.", {21: (122,), 26: (122,)}),
        ("Drone 21 and Drone 26 should track Target 122.", {21: (122,), 26: (122,)}),
        ("Target 122 is tracked by Drone 21, and Target 124 is tracked by Drone 26.", BOTH),
        ("Assign Target 122 to Drone 21.\nAssign Target 124 to Drone 26.", BOTH),
        ("Assign target 122 to drones 21 and 26.", {21: (122,), 26: (122,)}),
        ("Robot 21 tracks Target #122.", {21: (122,)}),
        ("Drone 21 should track Target 124 and avoid Target 122.", {21: (124,)}),
        ("Drone 21 should avoid Target 122 and track Target 124.", {21: (124,)}),
        ("Drone 21 should track Target 124 instead of Target 122.", {21: (124,)}),
        ("Drone 21 should not track Target 122 but Target 124.", {21: (124,)}),
        ("Drone 21 should stop tracking Target 122; Drone 26 tracks Target 124.", {26: (124,)}),
        ("Instead of Target 122, Drone 21 should track Target 124.", {21: (124,)}),
        ("Drone 21 is near Target 122, so Drone 21 should track Target 124.", {21: (124,)}),
        ("Drone 21 should switch from Target 122 to Target 124.", {21: (124,)}),
        ("Drone 21 was tracking Target 122 and should now track Target 124.", {21: (124,)}),
        ("Drone 21 should track Target 122 at 3.5 m and 2 m/s.", {21: (122,)}),
        ("Drone 21 should track Target 122.\nDrone 21 should also track Target 124.",
         {21: (122, 124)}),
        ("As Target 122 is near Drone 26, the plan is:\nDrone 21: Target 122", {21: (122,)}),
    ],
)  # fmt: skip
def test_plain_lines(text: str, rows: Rows) -> None:
    assert dict(read_task(text).assignment) == rows


def test_the_papers_case_study() -> None:
    text = (
        "Based on the information provided, here is the new tracking assignment for each drone:\n"
        "  - Drone 21 will track Target 122\n"
        "  - Drone 26 will track Target 124\n"
        "  Feedback to the human supervisor: The new tracking assignment has been optimized, "
        "ensuring that Drone 21 could also track Target 124."
    )
    answer = read_task(text)
    assert dict(answer.assignment) == BOTH
    assert answer.feedback.startswith("The new tracking assignment has been optimized")


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ('{"assignment": {"21": [122], "26": [124]}}', BOTH),
        ('```json\n{"assignment": {"21": [122], "26": [124]}}\n```', BOTH),
        ('Sure! {"assignment": {"21": [122], "26": [124]}} Hope this helps.', BOTH),
        ('{"assignment": {"Drone 21": ["Target 122"], "Drone 26": [124.0]}}', BOTH),
        ('{"assignment": {"21": 122, "26": null}}', {21: (122,), 26: ()}),
        ('{"assignment": [{"drone": 21, "targets": [122]}, {"drone": 26, "targets": [124]}]}',
         BOTH),
        ('{"21": [122], "26": [124]}', BOTH),
        ('<think>{"assignment": {"21": [1]}}</think>{"assignment": {"21": [122], "26": [124]}}',
         BOTH),
        ('thought without start</think>{"assignment": {"21": [122], "26": [124]}}', BOTH),
        ('{"assignment": {"21": [1]}} wait: {"assignment": {"21": [122], "26": [124]}}', BOTH),
        ('{"assignment": {"21": [122, "x", true, 1.5], "26": [124]}}',
         {21: (122, -1, -1, -1), 26: (124,)}),
    ],
)  # fmt: skip
def test_json(text: str, rows: Rows) -> None:
    assert dict(read_task(text).assignment) == rows


@pytest.mark.parametrize(
    "text",
    [
        '{"weights": {"tracking": 1, "control": 2, "sensing": 3, "communication": 4}, "replan": [2',
        '{"weights": {"tracking": 1, "control": 2, "sensing": 3, "communication": 4}, "x": [,]}',
        '{"a": {"weights": [1, 2, 3, 4]}, "feedback": "cut o',
    ],
)
def test_parts_of_a_broken_answer_are_no_answer(text: str) -> None:
    with pytest.raises(AnswerError):
        read_action(text)


SEVENS = "7" * 5000
"""More digits than Python turns into a whole number."""


def test_a_digit_repeated_for_ever_is_no_id_and_no_number() -> None:
    assert read_task(f'{{"assignment": {{"21": [{SEVENS}, 124]}}}}').assignment == (
        (21, (-1, 124)),
    )
    answer = read_action(f'{{"weights": [{SEVENS}, 1, 2, 3], "replan": [{SEVENS}]}}')
    assert answer.weights == (math.inf, 1.0, 2.0, 3.0)
    assert answer.replan == (-1,)
    with pytest.raises(AnswerError, match="cut off"):
        read_task(f'{{"assignment": {{"21": [{SEVENS}')
    assert read_action(f"[1, 2, 3, 4]\nReplan Drone {SEVENS}").replan == (777777777,)


def test_a_repeated_key_is_not_lost() -> None:
    answer = read_task('{"assignment": {"21": [122], "21": [124]}}')
    assert answer.assignment == ((21, (122,)), (21, (124,)))


def test_everything_else_in_a_json_answer() -> None:
    text = json.dumps(
        {
            "assignment": {"21": [122]},
            "capacities": [{"drone": 21, "capacity": 1}],
            "feedback": " Fine. ",
            "comments": [
                {"id": "c1", "verdict": "partly_applied", "reason": "Half."},
                {"id": "c2", "verdict": "whatever", "reason": "Unread."},
            ],
        }
    )
    answer = read_task(text)
    assert answer.capacities == ((21, 1),)
    assert answer.feedback == "Fine."
    assert answer.comments == (SaidOfComment("c1", CommentVerdict.PARTLY, "Half."),)


def test_comments_in_lines() -> None:
    text = (
        "Drone 21 should track Target 122.\n"
        "Comment c1: declined, Drone 99 does not exist.\n"
        "- **Comment c2**: partly applied: one of two.\n"
        "Feedback to the human supervisor: Done."
    )
    answer = read_task(text)
    assert dict(answer.assignment) == {21: (122,)}
    assert answer.feedback == "Done."
    assert answer.comments == (
        SaidOfComment("c1", CommentVerdict.DECLINED, "Drone 99 does not exist."),
        SaidOfComment("c2", CommentVerdict.PARTLY, "one of two."),
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty"),
        ("<think>Drone 21 should track Target 122.", "empty"),
        ("I'm sorry, but I can't help with that.", "refusal"),
        ("As an AI language model I cannot assign drones.", "refusal"),
        ("lorem ipsum", "no tracking assignment"),
        ("The targets are near.", "no tracking assignment"),
        ("{}", "no tracking assignment"),
        ("I cannot help with that.", "refusal"),
        ("I can’t assist with this request.", "refusal"),
        ("We will not take part in controlling drones.", "refusal"),
        ("I'm not able to advise on surveillance.", "refusal"),
        ("This goes against my guidelines.", "refusal"),
        ("[10, 0.05, 50, 50]", "no tracking assignment"),
    ],
)
def test_answers_without_an_assignment(text: str, words: str) -> None:
    with pytest.raises(AnswerError, match=words):
        read_task(text)


@pytest.mark.parametrize(
    ("text", "weights"),
    [
        ("[10, 0.05, 50, 50]", (10.0, 0.05, 50.0, 50.0)),
        ("The new weights are [10, .05, 5e1, 50.] as asked.", (10.0, 0.05, 50.0, 50.0)),
        ("From [1, 1, 1, 1] to **[10, 0.05, 50, 50]**", (10.0, 0.05, 50.0, 50.0)),
        ("[[10, 0.05, 50, 50]]", (10.0, 0.05, 50.0, 50.0)),
        ("[10 0.05 50 50]", (10.0, 0.05, 50.0, 50.0)),
        ("[]", ()),
        ("[1, 2, 3]", (1.0, 2.0, 3.0)),
        ("[1, 2, 3, 4, 5]", (1.0, 2.0, 3.0, 4.0, 5.0)),
        ("[-1, 1e999, 3, 4]", (-1.0, math.inf, 3.0, 4.0)),
        ("w1 = 10, w2 = 0.05, w3 = 50, w4 = 60", (10.0, 0.05, 50.0, 60.0)),
        ("1. tracking: 10\n2. control: 0.05\n3. sensing: 50\n4. communication: 60",
         (10.0, 0.05, 50.0, 60.0)),
        ('{"weights": [10, 0.05, 50, 60]}', (10.0, 0.05, 50.0, 60.0)),
        ('{"weights": {"communication": 60, "tracking": 10, "control": "0.05", "sensing": 50}}',
         (10.0, 0.05, 50.0, 60.0)),
        ('{"tracking": 10, "control": 0.05, "sensing": 50, "communication": 60}',
         (10.0, 0.05, 50.0, 60.0)),
        ('{"weights": {"w1": 10, "w2": 0.05, "w3": 50, "w4": 60}}', (10.0, 0.05, 50.0, 60.0)),
        ('{"weights": {"tracking": 10}}', (10.0,)),
        ('{"weights": [Infinity, 1, 2, 3]}', (math.inf, 1.0, 2.0, 3.0)),
    ],
)  # fmt: skip
def test_weights(text: str, weights: tuple[float, ...]) -> None:
    assert read_action(text).weights == weights


@pytest.mark.parametrize(
    "text", ["[nan, 1, 2, 3]", '{"weights": [NaN, 1, 2, 3]}', '{"weights": ["x", 1, 2, 3]}']
)
def test_what_is_no_number_stays_visible(text: str) -> None:
    weights = read_action(text).weights
    assert len(weights) == 4
    assert math.isnan(weights[0])


def test_everything_else_in_an_action_answer() -> None:
    text = (
        '{"weights": [10, 0.05, 50, 50], "severities": [{"zone": "s1", "severity": 2}], '
        '"replan": [21], "feedback": "More room.", "comments": []}'
    )
    lines = (
        "[10, 0.05, 50, 50]\nSeverity of zone s1: 2\nReplan Drone 21\n"
        "Feedback to the human supervisor: More room."
    )
    for written in (text, lines):
        answer = read_action(written)
        assert answer.severities == (("s1", 2.0),)
        assert answer.replan == (21,)
        assert answer.feedback == "More room."


@pytest.mark.parametrize("text", ["", "no", "I cannot assist with that.", "{}", "[a, b, c, d]"])
def test_answers_without_weights(text: str) -> None:
    with pytest.raises(AnswerError):
        read_action(text)


@pytest.mark.parametrize(
    "text", ['{"assignment": {}}', '{"assignment": []}', "No drone can be given a target."]
)
def test_an_empty_assignment_is_one(text: str) -> None:
    assert read_task(text).assignment == ()


def test_refusals() -> None:
    assert is_refusal("I'm sorry, I can't do that.")
    assert not is_refusal("Drone 21 should track Target 122.")
    assert not is_refusal("I cannot see a better plan than Drone 21 on Target 122.")


rows_strategy = st.dictionaries(
    st.integers(0, 200), st.lists(st.integers(0, 200), unique=True, max_size=4), min_size=1
)


@given(rows_strategy, st.sampled_from(["should track", "will track", "tracks", "->", ":"]))
def test_what_is_written_in_lines_is_read_back(rows: dict[int, list[int]], verb: str) -> None:
    lines = [
        f"Drone {robot_id} {verb} "
        + (" and ".join(f"Target {target_id}" for target_id in row) or "no target")
        for robot_id, row in rows.items()
    ]
    answer = read_task("\n".join(lines))
    assert dict(answer.assignment) == {robot_id: tuple(row) for robot_id, row in rows.items()}


@given(rows_strategy, st.text(max_size=40), st.text(max_size=40))
def test_what_is_written_in_json_is_read_back(
    rows: dict[int, list[int]], before: str, after: str
) -> None:
    before, after = (text.replace("{", "").replace("<", "") for text in (before, after))
    body = json.dumps({"assignment": rows, "feedback": "f"})
    answer = read_task(f"{before}{body}{after}")
    assert dict(answer.assignment) == {robot_id: tuple(row) for robot_id, row in rows.items()}


fragments = st.sampled_from(
    ["Drone 21", "drones 1 and 2", "Target 3", "targets 4, 5", "should", "track", "avoid", "not",
     "{", "}", "[", "]", '"', ":", ",", "\n", "1.", "NaN", "1e999", "<think>", "</think>", "```",
     "assignment", "weights", "Feedback:", "Comment c1: applied", "-", "|", "é", "\x00", "９"]
)  # fmt: skip


@settings(max_examples=300)
@given(st.one_of(st.text(), st.lists(fragments, max_size=40).map(" ".join)))
def test_no_text_breaks_the_reading(text: str) -> None:
    for read in (read_task, read_action):
        assert said(read, text) is not None


def said(read: Callable[[str], TaskAnswer | ActionAnswer], text: str) -> str:
    """Return what was understood, be it that nothing was."""
    try:
        return read(text).feedback
    except AnswerError as error:
        return str(error)


@pytest.mark.parametrize(
    "piece",
    ["\n", " ", "<think>", "{", "[", "[1 ", "Drone 1 ", "Target 1, ", "comment c: applied",
     "feedback", "1, and ", "severity of zone ", '{"a":', "w1", "__", "|"],
)  # fmt: skip
def test_no_text_makes_the_reading_slow(piece: str) -> None:
    text = piece * (60_000 // len(piece))
    started = time.process_time()
    for read in (read_task, read_action):
        said(read, text)
    assert time.process_time() - started < 15.0


def test_nearly_answers_do_no_harm() -> None:
    fared = campaign(seed=1, count=300)
    assert fared.total() == 600
    assert min(fared["Accepted"], fared["Retry"]) > 20, "some are right and some are wrong"
