"""The loops' clockwork: periodic, one call in flight, woken by events, on any clock."""

import pytest

from server.loops import DEBOUNCE_S, REST_S, LoopClock, LoopMeter


def test_first_call_is_due_at_once_then_once_a_period() -> None:
    clock = LoopClock(period_s=5.0)
    assert clock.due(0.0)
    clock.started(0.0)
    assert not clock.due(100.0), "one call in flight at most"
    clock.finished(0.9)
    assert not clock.due(4.9)
    assert clock.due(5.0)


def test_a_slow_model_is_left_alone_after_its_answer() -> None:
    clock = LoopClock(period_s=5.0)
    clock.started(0.0)
    clock.finished(12.0)
    assert clock.due_s == pytest.approx(12.0 + REST_S)


def test_events_wake_the_loop_once_after_the_debounce() -> None:
    clock = LoopClock(period_s=20.0)
    clock.started(0.0)
    clock.finished(1.0)
    clock.wake(7.0)
    clock.wake(7.1)
    assert not clock.due(7.2)
    assert clock.due(7.0 + DEBOUNCE_S)
    clock.started(7.3)
    clock.finished(8.0)
    assert clock.due_s == pytest.approx(27.3), "both events were answered by one call"


def test_an_event_during_a_call_is_answered_right_after_it() -> None:
    clock = LoopClock(period_s=20.0)
    clock.started(0.0)
    clock.wake(0.5)
    clock.finished(1.4)
    assert clock.due_s == pytest.approx(1.4 + DEBOUNCE_S)


def test_waking_never_delays_a_call_that_is_due_sooner() -> None:
    clock = LoopClock(period_s=5.0)
    clock.started(0.0)
    clock.finished(1.0)
    clock.wake(4.9)
    assert clock.due(5.0)


def test_a_second_start_is_an_error() -> None:
    clock = LoopClock(period_s=5.0)
    clock.started(0.0)
    with pytest.raises(RuntimeError):
        clock.started(1.0)
    clock.finished(1.0)
    with pytest.raises(RuntimeError):
        clock.finished(2.0)


def test_a_valid_answer_counts_before_anybody_has_decided_about_it() -> None:
    meter = LoopMeter()
    meter.record(1.0, 0.5, success=True)
    waiting = meter.report(2.0)
    assert (waiting.success_rate, waiting.age_s, waiting.adopted_rate) == (1.0, 1.0, None)
    meter.decided(adopted=False)
    meter.record(3.0, 0.5, success=True)
    meter.decided(adopted=True)
    after = meter.report(4.0)
    assert (after.success_rate, after.adopted_rate) == (1.0, 0.5)


def test_meter_reports_rate_mean_success_and_age() -> None:
    meter = LoopMeter()
    assert meter.report(0.0).rate_hz is None
    for k in range(11):
        meter.record(0.1 * k, 0.004, success=k != 10)
    meter.miss(2)
    report = meter.report(1.5)
    assert report.calls == 11
    assert report.missed == 2
    assert report.rate_hz == pytest.approx(10.0)
    assert report.mean_s == pytest.approx(0.004)
    assert report.success_rate == pytest.approx(10 / 11)
    assert report.age_s == pytest.approx(1.5 - 0.9)
