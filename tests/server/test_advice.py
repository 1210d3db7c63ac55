"""When our own assignment solver stands in for a task model that is silent."""

from dataclasses import replace

import pytest

from server.advice import SILENT_PERIODS, Relief
from server.gate.decisions import Decision, Loop, Refuser, Status
from solver.directives import Source

PERIOD_S = 20.0
LIMIT_S = SILENT_PERIODS * PERIOD_S


def card(time_s: float, refuser: Refuser | None = None, name: str = "d1") -> Decision:
    """A task model's answer that was decided at once."""
    return Decision(
        id=name,
        proposal_id="t1",
        loop=Loop.TASK,
        source=Source.TASK_LLM,
        author="task model",
        asked_s=time_s,
        time_s=time_s,
        status=Status.ADOPTED if refuser is None else Status.REFUSED,
        refused_by=refuser,
        decided_s=time_s,
    )


def solves(relief: Relief, until_s: float, from_s: float = 0.0) -> list[float]:
    """When it solves, looked at every second."""
    times = [from_s + second for second in range(int(until_s - from_s) + 1)]
    return [now_s for now_s in times if relief.due(now_s)]


def test_after_two_periods_of_silence_it_assigns_once_a_period() -> None:
    assert solves(Relief(PERIOD_S, 0.0), 100.0) == [40.0, 60.0, 80.0, 100.0]


def test_a_mission_that_goes_on_gives_the_model_time_first() -> None:
    assert solves(Relief(PERIOD_S, 300.0), 345.0, from_s=300.0) == [340.0]


@pytest.mark.parametrize("refuser", [None, Refuser.GATE, Refuser.PERSON, Refuser.TIMEOUT])
def test_a_valid_answer_ends_the_silence_whatever_became_of_it(refuser: Refuser | None) -> None:
    relief = Relief(PERIOD_S, 0.0)
    relief.note(card(30.0, refuser))
    assert solves(relief, 75.0) == [30.0 + LIMIT_S]
    relief.note(card(75.0, refuser))
    assert solves(relief, 120.0, from_s=76.0) == [75.0 + LIMIT_S]


@pytest.mark.parametrize("refuser", [Refuser.NO_ANSWER, Refuser.PARSING, Refuser.VERIFICATION])
def test_what_is_no_answer_is_silence(refuser: Refuser) -> None:
    relief = Relief(PERIOD_S, 0.0)
    relief.note(card(30.0, refuser))
    assert solves(relief, 45.0) == [40.0]


def test_other_loops_do_not_break_it() -> None:
    relief = Relief(PERIOD_S, 0.0)
    relief.note(replace(card(30.0), loop=Loop.ACTION))
    relief.note(replace(card(30.0), loop=Loop.PEOPLE))
    assert solves(relief, 45.0) == [40.0]


@pytest.mark.parametrize("status", [Status.ADOPTED, Status.REFUSED])
def test_nobody_stands_in_while_a_person_thinks_about_an_answer(status: Status) -> None:
    relief = Relief(PERIOD_S, 0.0)
    waiting = replace(card(10.0), status=Status.PENDING, decided_s=None)
    relief.note(waiting)
    assert solves(relief, 119.0) == []
    refuser = None if status is Status.ADOPTED else Refuser.TIMEOUT
    relief.note(replace(waiting, status=status, refused_by=refuser, decided_s=120.0))
    assert solves(relief, 165.0, from_s=120.0) == [120.0 + LIMIT_S]


def test_what_has_become_impossible_by_the_time_it_is_approved_is_no_answer() -> None:
    relief = Relief(PERIOD_S, 0.0)
    waiting = replace(card(10.0), status=Status.PENDING, decided_s=None)
    relief.note(waiting)
    relief.note(card(100.0, Refuser.VERIFICATION))
    assert solves(relief, 105.0, from_s=100.0) == [100.0]


def test_an_effect_that_is_told_late_is_no_new_answer() -> None:
    relief = Relief(PERIOD_S, 0.0)
    relief.note(card(5.0))
    assert solves(relief, 50.0) == [45.0]
    relief.note(card(5.0))
    assert solves(relief, 66.0, from_s=51.0) == [65.0]
