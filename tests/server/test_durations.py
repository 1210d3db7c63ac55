"""Durations and averages in bounded memory, against the same kept whole."""

import numpy as np
import pytest

from server.durations import EXACT, Average, Durations


def counted(values: np.ndarray) -> Durations:
    durations = Durations()
    for value in values.tolist():
        durations.add(value)
    return durations


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99, 1.0])
def test_quantiles_are_exact_until_there_are_many(share: float) -> None:
    few = np.random.default_rng(1).lognormal(-6.0, 1.0, 999)
    many = np.random.default_rng(2).lognormal(-6.0, 1.0, EXACT + 5000)
    assert counted(few).quantile_s(share) == np.quantile(few, share)
    assert counted(many).quantile_s(share) == pytest.approx(np.quantile(many, share), rel=0.011)
    assert counted(many).count == len(many)
    assert counted(many).longest_s == many.max()
    assert len(counted(many)._exact) == EXACT


def test_they_go_on_from_what_was_kept() -> None:
    values = np.random.default_rng(3).lognormal(-6.0, 1.0, 3000)
    before = counted(values[:2000])
    after = Durations.restored(dict(before.bins), before.longest_s)
    for value in values[2000:].tolist():
        after.add(value)
    assert after.count == 3000
    assert after.longest_s == values.max()
    for share in (0.5, 0.99):
        assert after.quantile_s(share) == pytest.approx(np.quantile(values, share), rel=0.011)


def test_nothing_has_no_quantile_and_no_mean() -> None:
    assert Durations().quantile_s(0.5) is None
    assert Average().mean is None


def test_nothing_lasts_no_time_and_is_counted() -> None:
    durations = counted(np.array([0.0, 0.0, 1.0]))
    assert durations.quantile_s(0.5) == 0.0
    assert durations.count == 3


def test_averages_add_up() -> None:
    first, second = Average(), Average()
    first.add(1.0)
    second.add(2.0)
    second.add(6.0)
    assert first.plus(second) == Average(9.0, 3)
    assert first.plus(second).mean == 3.0
