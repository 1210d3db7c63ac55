from server.live.complaints import MOST_CAUSES, REMINDER_S, Complaints


def test_trouble_is_told_once_and_then_now_and_then() -> None:
    complaints = Complaints()
    told = [complaints.failed("task", "no answer within 8 s", 5.0 * k) for k in range(40)]
    assert told[0] == 1
    assert [count for count in told if count is not None] == [1, 13, 25, 37]
    assert REMINDER_S == 60.0


def test_another_cause_is_told_at_once_but_other_figures_are_no_other_cause() -> None:
    complaints = Complaints()
    assert complaints.failed("task", "asked again in 30 s", 0.0) == 1
    assert complaints.failed("task", "asked again in 25 s", 5.0) is None
    assert complaints.failed("task", "the endpoint answered nonsense", 10.0) == 3
    assert complaints.failed("task", "asked again in 10 s", 15.0) is None


def test_a_model_with_ever_new_excuses_does_not_fill_the_list() -> None:
    complaints = Complaints()
    told = [complaints.failed("task", "x" * k, float(k)) for k in range(50)]
    assert sum(count is not None for count in told) == MOST_CAUSES


def test_loops_are_told_apart_and_a_valid_answer_ends_it() -> None:
    complaints = Complaints()
    assert complaints.failed("task", "a", 0.0) == 1
    assert complaints.failed("action", "a", 0.0) == 1
    complaints.failed("task", "a", 1.0)
    assert complaints.mended("task") == 2
    assert complaints.mended("task") == 0
    assert complaints.failed("task", "a", 2.0) == 1
