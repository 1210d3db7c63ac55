import logging

import pytest

from vehicles.repetition import MOST, PERIOD_S, Repetition


def test_a_flood_is_told_a_few_times_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    repetition = Repetition(logging.getLogger("test"))
    for number in range(10_000):
        repetition.warn(100.0 + 1e-4 * number, "message %d is refused", number)
    assert caplog.messages == [f"message {number} is refused" for number in range(MOST)]


def test_what_was_left_out_is_told_of_with_the_next(caplog: pytest.LogCaptureFixture) -> None:
    repetition = Repetition(logging.getLogger("test"))
    for _ in range(MOST + 7):
        repetition.warn(0.0, "refused")
    caplog.clear()
    repetition.warn(PERIOD_S, "refused")
    assert caplog.messages == ["... and 7 more of this kind", "refused"]


def test_what_is_seldom_is_always_told(caplog: pytest.LogCaptureFixture) -> None:
    repetition = Repetition(logging.getLogger("test"))
    for number in range(20):
        repetition.warn(PERIOD_S * number, "refused")
    assert caplog.messages == ["refused"] * 20
