"""Covariance intersection: consistent whatever the two sides have in common."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from solver import estimation
from solver.arrays import FloatArray
from solver.beliefs import Beliefs, FilterSettings, MotionModel
from solver.observations import OnboardTrack

WALK = FilterSettings()
CRUISE = FilterSettings(model=MotionModel.CONSTANT_VELOCITY)


def believed(mean: FloatArray, covariance: FloatArray) -> Beliefs:
    (a, b), (c, d) = covariance.tolist()
    x, y = mean.tolist()
    start = estimation.start((122, 124), WALK)
    return estimation.with_prior(start, 122, (x, y), ((a, b), (c, d)))


def track(mean: FloatArray, covariance: FloatArray, target_id: int = 122) -> OnboardTrack:
    return OnboardTrack(target_id, tuple(mean.tolist()), tuple(map(tuple, covariance.tolist())))


@given(seed=st.integers(0, 2**32 - 1), size=st.integers(4, 6))
def test_never_optimistic_for_any_correlation(seed: int, size: int) -> None:
    """For errors with any joint covariance, the fused one is not below the true one."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(4, size)) * 10.0 ** rng.uniform(-1, 1, size=(4, 1))
    joint = factor @ factor.T + 1e-6 * np.eye(4)
    A, B = joint[:2, :2], joint[2:, 2:]
    # The fused mean is linear in the two means: find the gains by probing.
    gains = np.empty((2, 4))
    for axis in range(4):
        unit = np.eye(4)[axis]
        fused = estimation.fuse(believed(unit[:2], A), (track(unit[2:], B),))
        gains[:, axis] = fused.means[0]
    claimed = estimation.position_covariances(fused)[0]
    actual = gains @ joint @ gains.T
    scale = np.trace(claimed)
    assert np.linalg.eigvalsh(claimed - actual)[0] >= -1e-7 * scale
    np.testing.assert_allclose(gains[:, :2] + gains[:, 2:], np.eye(2), atol=1e-6)


@given(seed=st.integers(0, 2**32 - 1))
def test_share_is_the_one_of_least_trace(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B = (f @ f.T + 0.01 * np.eye(2) for f in rng.normal(size=(2, 2, 2)))
    fused = estimation.fuse(believed(np.zeros(2), A), (track(np.ones(2), B),))

    def spread(share: float) -> float:
        information = share * np.linalg.inv(A) + (1.0 - share) * np.linalg.inv(B)
        return float(np.trace(np.linalg.inv(information)))

    best = minimize_scalar(spread, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9})
    least = min(float(best.fun), spread(0.0), spread(1.0))
    assert np.trace(fused.covariances[0]) <= least * (1.0 + 2e-3)


def test_an_unknown_target_is_taken_over() -> None:
    beliefs = replace(believed(np.zeros(2), np.eye(2)), unseen_s=np.array([2.0, 9.0]))
    fused = estimation.fuse(beliefs, (track(np.array([3.0, 4.0]), 0.5 * np.eye(2), 124),))
    assert fused.known.tolist() == fused.started.tolist() == [True, True]
    assert fused.unseen_s.tolist() == [2.0, 0.0]
    np.testing.assert_array_equal(fused.means[1], [3.0, 4.0])
    np.testing.assert_array_equal(fused.covariances[1], 0.5 * np.eye(2))
    np.testing.assert_array_equal(fused.covariances[0], np.eye(2))


SINGULAR = ((0.010000000000000002, 0.22000000000000003), (0.22000000000000003, 4.840000000000001))
"""What rounding takes for positive definite, and nobody can invert."""


@pytest.mark.parametrize(
    "rubbish",
    [
        OnboardTrack(999, (0.0, 0.0), ((1.0, 0.0), (0.0, 1.0))),
        OnboardTrack(122, (float("nan"), 0.0), ((1.0, 0.0), (0.0, 1.0))),
        OnboardTrack(122, (0.0, 0.0), ((1.0, 0.0), (0.0, -1.0))),
        OnboardTrack(122, (0.0, 0.0), ((1.0, 0.0), (0.0,))),
        OnboardTrack(122, (0.0, 0.0, 0.0), ((1.0, 0.0), (0.0, 1.0))),
        OnboardTrack(122, (0.0, 0.0), SINGULAR),
        OnboardTrack(122, (1e12, 0.0), ((1e-300, 0.0), (0.0, 1e12))),
    ],
)
def test_rubbish_is_ignored(rubbish: OnboardTrack) -> None:
    beliefs = believed(np.zeros(2), np.eye(2))
    assert estimation.fuse(beliefs, (rubbish,)) is beliefs


def test_tracks_of_the_other_motion_model_count_with_their_position() -> None:
    state = np.array([1.0, 1.0, 0.2, 0.0])
    fused = estimation.fuse(
        believed(np.zeros(2), np.eye(2)), (track(state, np.diag([0.1, 0.1, 1.0, 1.0])),)
    )
    assert np.trace(fused.covariances[0]) == pytest.approx(0.2, rel=0.02)
    cruise = estimation.with_prior(
        estimation.start((122,), CRUISE), 122, (0.0, 0.0), ((1.0, 0.0), (0.0, 1.0))
    )
    fused = estimation.fuse(cruise, (track(np.ones(2), 0.1 * np.eye(2)),))
    np.linalg.cholesky(fused.covariances)
    assert fused.covariances[0, 0, 0] < 0.11
    assert fused.covariances[0, 2, 2] >= cruise.covariances[0, 2, 2]
