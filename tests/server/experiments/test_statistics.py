import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from server.experiments.statistics import estimate, paired

values = st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=40).filter(lambda v: np.ptp(v) > 1e-3)


@given(values)
def test_a_mean_has_the_interval_of_a_t_test(sample: list[float]) -> None:
    found = estimate(sample)
    assert found is not None
    interval = stats.ttest_1samp(sample, 0.0).confidence_interval(0.95)
    assert found.lower == pytest.approx(interval.low, rel=1e-6, abs=1e-6)
    assert found.upper == pytest.approx(interval.high, rel=1e-6, abs=1e-6)


def test_paired_differences_have_the_interval_of_a_paired_t_test() -> None:
    dice = np.random.default_rng(4)
    world = dice.normal(0.0, 10.0, 20)
    first = dict(enumerate((world + dice.normal(1.0, 0.5, 20)).tolist()))
    second = dict(enumerate((world + dice.normal(0.0, 0.5, 20)).tolist()))
    found, alone = paired(first, second), estimate(list(first.values()))
    assert found is not None
    assert alone is not None
    test = stats.ttest_rel(list(first.values()), list(second.values()))
    interval = test.confidence_interval(0.95)
    assert found.lower == pytest.approx(interval.low)
    assert found.upper == pytest.approx(interval.high)
    # The world's own luck cancels: that is what pairing is for.
    assert found.half_width is not None
    assert alone.half_width is not None
    assert found.half_width < 0.2 * alone.half_width


def test_only_seeds_that_both_have_are_compared() -> None:
    found = paired({0: 5.0, 1: 7.0, 2: 100.0}, {1: 4.0, 0: 3.0, 9: -50.0})
    assert found is not None
    assert (found.mean, found.count) == (2.5, 2)


def test_little_is_told_of_few_values() -> None:
    assert estimate([]) is None
    assert paired({0: 1.0}, {1: 1.0}) is None
    single = estimate([3.0])
    assert single is not None
    assert (single.mean, single.half_width) == (3.0, None)
    assert (single.lower, single.upper) == (-math.inf, math.inf)
