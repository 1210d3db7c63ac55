"""Near sightings against brute force: integrals on a fine grid, and general minimisation."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from solver import nearfield
from solver.arrays import FloatArray
from solver.nearfield import Posterior
from solver.problem import SensorModel
from solver.sensing import TARGET_FLOOR_M, wrapped
from solver.sightings import Sightings
from tests.solver.measuring import noise_variances

# Without shapes the noise is the same at all distances, and the grid knows it, too.
CAMERA = SensorModel(40.0, 0.0, 150.0, 0.0)
PAPER = SensorModel(15.0, 0.0, 15.0, 0.0)
ROBOT = np.array([3.0, -2.0])


def one(distance: float, bearing: float) -> Sightings:
    numbers = (np.array([value]) for value in (*ROBOT, distance, bearing))
    return Sightings(np.zeros(1, dtype=np.int64), *numbers)


def price(
    x: FloatArray, mean: FloatArray, P: FloatArray, z: tuple[float, float], R: tuple[float, float]
) -> FloatArray:
    """Twice the negative log posterior at offsets (..., 2), up to a constant."""
    e = x - mean
    distance, angle = np.hypot(x[..., 0], x[..., 1]), np.arctan2(x[..., 1], x[..., 0])
    prior = np.einsum("...i,ij,...j", e, np.linalg.inv(P), e)
    turned = wrapped(z[1] - angle)
    return np.asarray(prior + (z[0] - distance) ** 2 / R[0] + turned**2 / R[1])


def brute(
    mean: FloatArray, P: FloatArray, z: tuple[float, float], R: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance of the posterior from a fine grid in the plane."""
    reach = 6.0 * np.sqrt(np.linalg.eigvalsh(P)[1])
    axis = np.linspace(-reach, reach, 1201)
    x = mean + np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    cost = price(x, mean, P, z, R)
    weight = np.exp(-0.5 * (cost - cost.min()))
    weight /= weight.sum()
    centre = weight @ x
    return centre, np.einsum("n,ni,nj->ij", weight, x - centre, x - centre)


def drawn(seed: int, sensor: SensorModel) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
    """Return a prior of the offset and what was measured of a target drawn from it."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    P = turn @ np.diag(rng.uniform(0.1, 0.5, size=2) ** 2) @ turn.T
    mean = rng.normal(size=2) * rng.uniform(0.0, 0.8)
    truth = rng.multivariate_normal(mean, P)
    deviations = np.sqrt(noise_variances(sensor, 0.0)) * rng.normal(size=2)
    bearing = float(np.arctan2(truth[1], truth[0]) + deviations[1])
    return mean, P, (float(np.hypot(*truth) + deviations[0]), bearing)


@pytest.mark.parametrize("sensor", [CAMERA, PAPER], ids=["camera", "paper"])
@pytest.mark.parametrize("seed", range(12))
def test_moments_are_those_of_the_posterior(sensor: SensorModel, seed: int) -> None:
    mean, P, z = drawn(seed, sensor)
    w, v = noise_variances(sensor, 0.0)
    caution = (1.0 + TARGET_FLOOR_M**2 / (mean @ mean + np.trace(P))) ** 2
    centre, spread = brute(mean, P, z, (w, v * caution))
    found = nearfield.moments(one(*z), sensor, (ROBOT + mean)[None], P[None])
    deviation = np.sqrt(np.trace(spread))
    np.testing.assert_allclose(found.means[0], centre, atol=0.05 * deviation)
    np.testing.assert_allclose(found.covariances[0], spread, atol=0.05 * deviation**2)


@pytest.mark.parametrize("sensor", [CAMERA, PAPER], ids=["camera", "paper"])
def test_the_mode_is_the_most_likely_place(sensor: SensorModel) -> None:
    missed = 0
    for seed in range(40):
        mean, P, z = drawn(seed, sensor)
        given_noise = noise_variances(sensor, 0.0)
        found = nearfield.mode(one(*z), sensor, (ROBOT + mean)[None], P[None])
        least = min(
            minimize(price, start, args=(mean, P, z, given_noise), method="Nelder-Mead").fun
            for start in (mean, found.means[0], abs(z[0]) * np.array([np.cos(z[1]), np.sin(z[1])]))
        )
        # A target straight above is in no direction: any is as good.
        place = found.means[0] + 1e-9 * np.array([np.cos(z[1]), np.sin(z[1])])
        ours = float(price(place, mean, P, z, given_noise))
        assert found.surprise[0] == pytest.approx(ours, abs=1e-5)
        missed += ours > least + 0.01
    # Where two places are about equally likely it may find the other.
    assert missed <= 1


@pytest.mark.parametrize("form", [nearfield.moments, nearfield.mode])
def test_from_afar_both_are_the_kalman_filter(form: Callable[..., Posterior]) -> None:
    mean, P = np.array([30.0, 40.0]), np.array([[0.02, 0.005], [0.005, 0.03]])
    sharp = SensorModel(400.0, 0.0, 1e6, 0.0)
    w, v = noise_variances(sharp, 0.0)
    z = (50.06, float(np.arctan2(40.0, 30.0)) + 0.002)
    found = form(one(*z), sharp, (ROBOT + mean)[None], P[None])
    H = np.array([mean / 50.0, [-mean[1] / 2500.0, mean[0] / 2500.0]])
    nu, S = np.array([0.06, 0.002]), H @ P @ H.T + np.diag([w, v])
    K = P @ H.T @ np.linalg.inv(S)
    np.testing.assert_allclose(found.means[0], mean + K @ nu, atol=2e-3)
    np.testing.assert_allclose(found.covariances[0], P - K @ S @ K.T, rtol=0.02, atol=1e-5)
    assert found.surprise[0] == pytest.approx(nu @ np.linalg.solve(S, nu), rel=0.02, abs=0.02)


@given(
    x=st.floats(-10, 10),
    y=st.floats(-10, 10),
    scale=st.floats(-8, 8),
    ratio=st.floats(0, 11),
    measured=st.floats(-1e3, 1e4),
    bearing=st.floats(-np.pi, np.pi),
    peak=st.sampled_from([1e-6, 15.0, 1e9]),
    shape=st.sampled_from([0.0, 0.2, 3.0]),
    form=st.sampled_from([nearfield.moments, nearfield.mode]),
)
def test_nothing_makes_it_break(
    x: float,
    y: float,
    scale: float,
    ratio: float,
    measured: float,
    bearing: float,
    peak: float,
    shape: float,
    form: Callable[..., Posterior],
) -> None:
    P = 10.0**scale * np.diag([1.0, 10.0**-ratio])[None]
    sensor = SensorModel(peak, shape, peak, shape)
    found = form(one(measured, bearing), sensor, (ROBOT + np.array([x, y]))[None], P)
    assert np.isfinite(found.means).all()
    assert np.isfinite(found.covariances).all()
    assert np.isfinite(found.surprise).all()
    assert np.linalg.eigvalsh(found.covariances[0])[0] >= -1e-9 * np.trace(found.covariances[0])


def test_exactly_above_a_target_is_a_place_like_any_other() -> None:
    P = 0.04 * np.eye(2)[None]
    found = nearfield.moments(one(0.0, 0.5), PAPER, ROBOT[None], P)
    assert 0.0 < np.hypot(*found.means[0]) < 0.2
    assert np.arctan2(*found.means[0][::-1]) == pytest.approx(0.5, abs=1e-6)
    assert np.trace(found.covariances[0]) < np.trace(P[0])
