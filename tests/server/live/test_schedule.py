import pytest

from server.live.schedule import Schedule


def test_ticks_are_due_on_the_grid_however_long_each_takes() -> None:
    schedule = Schedule(0.1, 50.0)
    due = []
    for took_s in (0.0, 0.03, 0.099, 0.05):
        due.append(schedule.due_s)
        assert schedule.advance(schedule.due_s + took_s) == 0
    assert due == pytest.approx([50.0, 50.1, 50.2, 50.3])


def test_late_ticks_are_skipped_and_counted_not_made_up_for() -> None:
    schedule = Schedule(0.1, 0.0)
    assert schedule.advance(0.35) == 3  # 0.1, 0.2 and 0.3 have passed
    assert schedule.due_s == pytest.approx(0.4)
    assert schedule.advance(0.41) == 0
    assert schedule.due_s == pytest.approx(0.5)


def test_a_tick_that_ends_as_the_next_is_due_gives_that_one_up() -> None:
    schedule = Schedule(0.1, 0.0)
    assert schedule.advance(0.1) == 1
    assert schedule.due_s == pytest.approx(0.2)


def test_there_is_no_drift_after_a_million_ticks() -> None:
    schedule = Schedule(0.1, 0.0)
    for _ in range(10**6):
        schedule.advance(schedule.due_s + 0.01)
    assert schedule.due_s == pytest.approx(1e5, abs=1e-6)
