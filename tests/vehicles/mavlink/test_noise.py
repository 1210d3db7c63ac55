"""Noise on a link is told once for as long as it lasts."""

from vehicles.mavlink.codec import Counts
from vehicles.mavlink.noise import NOISY, QUIET_S, NoiseWatch


def test_a_broken_frame_now_and_then_is_not_worth_a_word() -> None:
    watch, counts = NoiseWatch(), Counts()
    for second in range(60):
        counts.bad += NOISY - 1
        assert watch.look(counts, float(second)) is None


def test_much_noise_is_told_once_until_it_was_quiet() -> None:
    watch, counts = NoiseWatch(), Counts()
    told = []
    for second in range(40):
        if second < 15 or second >= 15 + QUIET_S + 2:
            counts.truncated += NOISY
            counts.implausible += NOISY
        told.append(watch.look(counts, float(second)))
    words = f"{2 * NOISY} frames within a second could not be used: noise"
    assert [second for second, text in enumerate(told) if text == words] == [0, 15 + QUIET_S + 2]
    assert told.count(None) == len(told) - 2


def test_other_systems_and_messages_that_nobody_knows_are_no_noise() -> None:
    watch, counts = NoiseWatch(), Counts()
    for second in range(10):
        counts.foreign += 100
        counts.unknown += 100
        assert watch.look(counts, float(second)) is None


def test_looks_that_come_often_count_a_whole_second() -> None:
    watch, counts = NoiseWatch(), Counts()
    assert watch.look(counts, 0.0) is None
    told = []
    for tick in range(1, 21):
        counts.bad += 1
        told.append(watch.look(counts, tick / 10.0))
    assert [text is not None for text in told].index(True) == 9
