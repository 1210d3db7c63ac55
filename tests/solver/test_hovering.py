"""The update near targets, where robots are sent: it loses none, and keeps its word."""

import numpy as np
import pytest
from scipy.stats import chi2

from solver import estimation
from solver.arrays import FloatArray
from solver.beliefs import Beliefs, FilterSettings
from solver.observations import Detections, Sighting
from solver.problem import SensorModel
from solver.sensing import wrapped
from tests.solver.measuring import noise_variances, predicted

SENSOR = SensorModel()
RUNS = 120


def sighted(
    robot: FloatArray, target: FloatArray, target_id: int, rng: np.random.Generator
) -> Detections:
    place = (float(robot[0]), float(robot[1]))
    distance, bearing = predicted(place, (float(target[0]), float(target[1])))
    deviations = np.sqrt(noise_variances(SENSOR, distance))
    noisy = np.array([distance, bearing]) + deviations * rng.normal(size=2)
    return Detections(1, place, (Sighting(target_id, noisy[0], float(wrapped(noisy[1:])[0])),))


def expecting(places: FloatArray, variance: float, settings: FilterSettings) -> Beliefs:
    ids = tuple(range(len(places)))
    beliefs = estimation.start(ids, settings)
    for target_id, (x, y) in zip(ids, places.tolist(), strict=True):
        beliefs = estimation.with_prior(
            beliefs, target_id, (x, y), ((variance, 0.0), (0.0, variance))
        )
    return beliefs


def flown(radius: float, robots: int, dt: float, q: float) -> tuple[FloatArray, FloatArray]:
    """Follow random walks from robots that hover near the estimate; return NEES and errors."""
    settings = FilterSettings(process_noise=q, drop_after_s=1e9)
    rng = np.random.default_rng(1)
    beliefs = expecting(np.zeros((RUNS, 2)), 0.01, settings)
    targets = rng.normal(size=(RUNS, 2)) * 0.1
    squares, errors = [], []
    for step in range(60):
        targets = targets + np.sqrt(q * dt) * rng.normal(size=targets.shape)
        beliefs = estimation.predict(beliefs, settings, dt)
        batch = []
        for robot in range(robots):
            angle = 2.2 * robot + 0.3
            places = beliefs.means + radius * np.array([np.cos(angle), np.sin(angle)])
            batch += [sighted(places[i], targets[i], i, rng) for i in range(RUNS)]
        beliefs = estimation.update(beliefs, settings, SENSOR, tuple(batch))
        error = beliefs.means - targets
        if step >= 20 and step % 4 == 0:
            solved = np.linalg.solve(beliefs.covariances, error[:, :, None])[:, :, 0]
            squares.append((error * solved).sum(axis=1))
        errors.append(np.hypot(error[:, 0], error[:, 1]))
    return np.array(squares), np.array(errors)


@pytest.mark.parametrize("robots", [1, 2])
@pytest.mark.parametrize("radius", [1.0, 3.0])
def test_errors_are_as_large_as_claimed(radius: float, robots: int) -> None:
    """Mean normalised squared error against its chi-square bounds (runs are independent)."""
    squares, _ = flown(radius, robots, 0.1, 0.1)
    by_run = squares.mean(axis=0)
    low, high = chi2.ppf([0.0005, 0.9995], 2 * RUNS) / RUNS
    # Errors of one run are correlated over time: the bound is that of a single moment.
    assert low < by_run.mean() < high


@pytest.mark.parametrize("dt", [0.1, 0.5])
@pytest.mark.parametrize("robots", [1, 2])
@pytest.mark.parametrize("radius", [0.1, 0.2, 0.35, 0.6])
def test_hovering_beside_a_target_never_loses_it(radius: float, robots: int, dt: float) -> None:
    """The textbook filter is off by more than the universe here."""
    squares, errors = flown(radius, robots, dt, 0.1)
    assert np.sqrt((errors**2).mean()) < 0.3
    assert errors.max() < 2.0
    assert squares.mean() < 4.0
