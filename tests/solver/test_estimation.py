"""The batched filter against filterpy, and what must never happen to a covariance."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import ExtendedKalmanFilter
from hypothesis import given
from hypothesis import strategies as st

from solver import estimation
from solver.arrays import FloatArray
from solver.beliefs import Beliefs, FilterSettings, MotionModel, NearField
from solver.observations import Detections, Sighting
from solver.problem import SensorModel
from solver.sensing import TARGET_FLOOR_M, wrapped
from solver.snapshot import TrackStatus
from tests.solver.measuring import noise_variances, predicted

SENSOR = SensorModel()
IDS = (122, 124, 126)
WALK = FilterSettings(process_noise=0.1, gate_probability=None)
CRUISE = replace(WALK, model=MotionModel.CONSTANT_VELOCITY, process_noise=0.02)
EITHER = pytest.mark.parametrize("settings", [WALK, CRUISE], ids=["walk", "cruise"])


def seen(
    robot: tuple[float, float], targets: dict[int, tuple[float, float]], noise: FloatArray
) -> Detections:
    sightings = []
    for (target_id, position), (n_range, n_bearing) in zip(targets.items(), noise, strict=True):
        distance, bearing = predicted(robot, position)
        variances = noise_variances(SENSOR, distance)
        sightings.append(
            Sighting(
                target_id,
                distance + n_range * np.sqrt(variances[0]),
                float(wrapped(np.array(bearing + n_bearing * np.sqrt(variances[1])))),
            )
        )
    return Detections(1, robot, tuple(sightings))


def known(settings: FilterSettings) -> Beliefs:
    beliefs = estimation.start(IDS, settings)
    for k, target_id in enumerate(IDS):
        beliefs = estimation.with_prior(
            beliefs, target_id, (3.0 * k, 1.0 + k), ((0.3, 0.05), (0.05, 0.2))
        )
    return beliefs


class Oracle:
    """filterpy's extended Kalman filter for one target, robots stacked in one measurement."""

    def __init__(self, mean: FloatArray, covariance: FloatArray, settings: FilterSettings) -> None:
        self.settings = settings
        self.filter = ExtendedKalmanFilter(dim_x=len(mean), dim_z=2)
        self.filter.x, self.filter.P = mean.copy(), covariance.copy()

    def predict(self, dt: float) -> None:
        size, q = len(self.filter.x), self.settings.process_noise
        self.filter.F = np.eye(size)
        if size == 2:
            self.filter.Q = q * dt * np.eye(2)
        else:
            self.filter.F[:2, 2:] = dt * np.eye(2)
            self.filter.Q = Q_continuous_white_noise(
                dim=2, dt=dt, spectral_density=q, block_size=2, order_by_dim=False
            )
        self.filter.predict()

    def update(self, robots: list[tuple[float, float]], sightings: list[Sighting]) -> None:
        rows, expected, measured, noise = [], [], [], []
        for robot, sighting in zip(robots, sightings, strict=True):
            d = self.filter.x[:2] - np.array(robot)
            rho = np.sqrt(d @ d + TARGET_FLOOR_M**2)
            row = np.zeros((2, len(self.filter.x)))
            row[0, :2] = d / rho
            row[1, :2] = np.array([-d[1], d[0]]) / rho**2
            rows.append(row)
            expected += list(predicted(robot, (self.filter.x[0], self.filter.x[1])))
            measured += [sighting.range_m, sighting.bearing_rad]
            noise += list(noise_variances(SENSOR, float(np.hypot(*d))))
        H, hx = np.vstack(rows), np.array(expected)

        def residual(a: FloatArray, b: FloatArray) -> FloatArray:
            difference = a - b
            difference[1::2] = wrapped(difference[1::2])
            return difference

        self.filter.dim_z = len(measured)
        self.filter.update(
            np.array(measured), lambda _: H, lambda _: hx, R=np.diag(noise), residual=residual
        )


@EITHER
def test_equals_filterpy_on_the_same_data(settings: FilterSettings) -> None:
    """From afar, where the extended Kalman filter holds."""
    rng = np.random.default_rng(3)
    settings = replace(settings, speed_variance=0.01)
    beliefs = known(settings)
    oracles = [
        Oracle(m, P, settings) for m, P in zip(beliefs.means, beliefs.covariances, strict=True)
    ]
    for step in range(60):
        dt = 0.1 if step % 2 else 0.5
        beliefs = estimation.predict(beliefs, settings, dt)
        for oracle in oracles:
            oracle.predict(dt)
        truth = {t: (3.0 * k + 0.02 * step, 1.0 + k) for k, t in enumerate(IDS)}
        robots = [(3.0 + 0.1 * step, 8.0), (1.0, -6.0 - 0.05 * step), (9.0, -5.0)]
        # The second robot sees only two targets; the third target is unseen at times.
        views = [truth if step % 3 else {122: truth[122]}, {t: truth[t] for t in IDS[:2]}, truth]
        batch = [
            seen(robot, view, rng.normal(size=(len(view), 2)))
            for robot, view in zip(robots, views, strict=True)
        ]
        beliefs = estimation.update(beliefs, settings, SENSOR, tuple(batch))
        for target_id, oracle in zip(IDS, oracles, strict=True):
            found = [
                (d.position, s) for d in batch for s in d.sightings if s.target_id == target_id
            ]
            oracle.update([robot for robot, _ in found], [s for _, s in found])
        for k, oracle in enumerate(oracles):
            np.testing.assert_allclose(beliefs.means[k], oracle.filter.x, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(
                beliefs.covariances[k], oracle.filter.P, rtol=1e-8, atol=1e-12
            )


@EITHER
@pytest.mark.parametrize("near_field", NearField)
def test_covariances_stay_positive_definite_for_ever(
    settings: FilterSettings, near_field: NearField
) -> None:
    """Two million updates of 500 targets at wild distances, noise levels and time steps."""
    rng = np.random.default_rng(0)
    settings = replace(settings, near_field=near_field)
    ids = tuple(range(500))
    sensors = [SensorModel(), SensorModel(1e9, 0.0, 1e9, 0.0), SensorModel(1e-6, 3.0, 1e-6, 3.0)]
    beliefs = estimation.start(ids, settings)
    for target_id in ids[:3]:
        beliefs = estimation.with_prior(beliefs, target_id, (0.0, 0.0), ((1e-9, 0.0), (0.0, 1e8)))
    beliefs = replace(beliefs, known=np.ones(len(ids), dtype=np.bool_))
    updates = 0
    for step in range(1000):
        if step % 20 == 0:
            robots = rng.normal(size=(4, 2)) * 10.0 ** rng.uniform(-3, 3)
            ranges = np.abs(rng.normal(size=(4, len(ids)))) * 10.0 ** rng.uniform(-2, 3)
            bearings = rng.uniform(-np.pi, np.pi, size=(4, len(ids)))
            batch = tuple(
                Detections(i, tuple(robots[i]), tuple(map(Sighting, ids, ranges[i], bearings[i])))
                for i in range(4)
            )
        beliefs = estimation.predict(beliefs, settings, float(10.0 ** rng.uniform(-4, 1)))
        beliefs = estimation.update(beliefs, settings, sensors[step % 3], batch)
        updates += 4 * len(ids)
        assert np.isfinite(beliefs.means).all()
        transposed = np.swapaxes(beliefs.covariances, 1, 2)
        np.testing.assert_array_equal(beliefs.covariances, transposed)
        np.linalg.cholesky(beliefs.covariances)
    assert updates == 2_000_000


def test_two_robots_at_right_angles_see_better_than_side_by_side() -> None:
    target = {122: (0.0, 0.0)}
    quiet = np.zeros((1, 2))

    def after(*robots: tuple[float, float]) -> float:
        beliefs = estimation.with_prior(
            estimation.start((122,), WALK), 122, (0.0, 0.0), ((0.25, 0.0), (0.0, 0.25))
        )
        batch = tuple(seen(robot, target, quiet) for robot in robots)
        return estimation.trace(estimation.update(beliefs, WALK, SENSOR, batch))

    apart, together = after((3.0, 0.0), (0.0, 3.0)), after((3.0, 0.0), (3.0, 0.01))
    assert apart < 0.9 * together
    assert after((3.0, 0.0)) > together


@EITHER
def test_a_track_starts_from_one_sighting_and_holds_the_truth(settings: FilterSettings) -> None:
    rng = np.random.default_rng(1)
    robot, target = (1.0, 2.0), (5.0, -1.0)
    inside = 0
    for _ in range(400):
        beliefs = estimation.start((122,), settings)
        sighting = seen(robot, {122: target}, rng.normal(size=(1, 2)))
        beliefs = estimation.update(beliefs, settings, SENSOR, (sighting,))
        assert beliefs.known.all()
        error = beliefs.means[0, :2] - target
        P = estimation.position_covariances(beliefs)[0]
        inside += bool(error @ np.linalg.solve(P, error) < 5.99)
    assert inside / 400 > 0.9


def test_an_outlier_is_gated_and_counted() -> None:
    settings = replace(WALK, gate_probability=0.999)
    beliefs = known(settings)
    robot = (0.0, -3.0)
    wild = Detections(1, robot, (Sighting(122, 30.0, -2.0),))
    after = estimation.update(beliefs, settings, SENSOR, (wild,))
    np.testing.assert_array_equal(after.means, beliefs.means)
    np.testing.assert_array_equal(after.covariances, beliefs.covariances)
    assert after.rejected.tolist() == [1, 0, 0]
    honest = seen(robot, {122: (0.0, 1.0)}, np.zeros((1, 2)))
    healed = estimation.update(after, settings, SENSOR, (wild, honest))
    assert healed.rejected.tolist() == [0, 0, 0]
    alone = estimation.update(beliefs, settings, SENSOR, (honest,))
    np.testing.assert_allclose(healed.means, alone.means, atol=1e-14)


@pytest.mark.parametrize("turn", np.arange(0.2, 2.0 * np.pi, 0.7))
@pytest.mark.parametrize("share", [0.98, 1.02])
def test_the_gate_is_where_the_innovation_is_as_unlikely_as_told(share: float, turn: float) -> None:
    """From afar, range and bearing both off by a little less or more than the quantile."""
    settings = replace(WALK, gate_probability=0.99)
    sensor = SensorModel(20.0, 0.1, 2000.0, 0.1)  # so sharp that the prior's doubt counts
    mean, P = np.array([9.0, 5.0]), np.array([[0.3, 0.1], [0.1, 0.2]])
    beliefs = estimation.with_prior(
        estimation.start((122,), settings), 122, (9.0, 5.0), ((0.3, 0.1), (0.1, 0.2))
    )
    distance, bearing = predicted((0.0, 0.0), (9.0, 5.0))
    rho = np.hypot(distance, TARGET_FLOOR_M)
    H = np.array([mean / rho, np.array([-mean[1], mean[0]]) / rho**2])
    S = H @ P @ H.T + np.diag(noise_variances(sensor, distance))
    # 1 - exp(-t / 2) = 0.99 for two degrees of freedom.
    radius = np.sqrt(-2.0 * np.log(0.01))
    off = share * radius * np.linalg.cholesky(S) @ np.array([np.cos(turn), np.sin(turn)])
    told = Detections(1, (0.0, 0.0), (Sighting(122, distance + off[0], bearing + off[1]),))
    after = estimation.update(beliefs, settings, sensor, (told,))
    assert after.rejected.tolist() == [0 if share < 1.0 else 1]


@EITHER
@pytest.mark.parametrize(
    ("step_s", "rounds", "given_up"), [(0.5, 3, True), (0.3, 3, False), (0.9, 2, False)]
)
def test_a_track_that_every_sighting_contradicts_is_given_up_for_where_they_are(
    step_s: float, rounds: int, given_up: bool, settings: FilterSettings
) -> None:
    """After three in a row and a second that nothing confirmed it, not before."""
    settings = replace(settings, gate_probability=0.999)
    beliefs = known(settings)
    elsewhere = (-6.0, 7.0)
    told = seen((-4.0, 3.0), {122: elsewhere}, np.zeros((1, 2)))
    other = seen((-4.0, 3.0), {124: (3.0, 2.0)}, np.zeros((1, 2)))
    for _ in range(rounds):
        beliefs = estimation.predict(beliefs, settings, step_s)
        beliefs = estimation.update(beliefs, settings, SENSOR, (told, other))
    assert beliefs.known.all()
    found = float(np.hypot(*(beliefs.means[0, :2] - elsewhere)))
    if given_up:
        assert found < 0.5
        assert beliefs.rejected.tolist() == [0, 0, 0]
        assert beliefs.unseen_s.tolist() == [0.0, 0.0, pytest.approx(rounds * step_s)]
    else:
        assert found > 5.0
        assert beliefs.rejected.tolist() == [rounds, 0, 0]
    np.testing.assert_allclose(beliefs.means[1, :2], (3.0, 2.0), atol=0.2)


def test_a_prior_replaces_the_place_and_leaves_the_velocity() -> None:
    beliefs = estimation.predict(known(CRUISE), CRUISE, 2.0)
    beliefs = replace(
        beliefs,
        means=beliefs.means + np.array([0.0, 0.0, 0.3, -0.1]),
        rejected=np.array([2, 2, 2]),
    )
    assert (beliefs.covariances[1, :2, 2:] != 0.0).any()
    after = estimation.with_prior(beliefs, 124, (8.0, 9.0), ((0.5, 0.2), (0.2, 0.4)))
    np.testing.assert_allclose(after.means[1], [8.0, 9.0, 0.3, -0.1])
    expected = np.zeros((4, 4))
    expected[:2, :2] = ((0.5, 0.2), (0.2, 0.4))
    expected[2:, 2:] = beliefs.covariances[1, 2:, 2:]
    np.testing.assert_array_equal(after.covariances[1], expected)
    for row in (0, 2):
        np.testing.assert_array_equal(after.means[row], beliefs.means[row])
        np.testing.assert_array_equal(after.covariances[row], beliefs.covariances[row])
    assert after.unseen_s.tolist() == [2.0, 0.0, 2.0]
    assert after.rejected.tolist() == [2, 0, 2]
    assert beliefs.unseen_s.tolist() == [2.0, 2.0, 2.0]


def test_unknown_targets_and_broken_numbers_are_ignored() -> None:
    beliefs = known(WALK)
    rubbish = (
        Detections(1, (0.0, 0.0), (Sighting(999, 1.0, 0.0), Sighting(122, float("nan"), 0.0))),
        Detections(2, (float("inf"), 0.0), (Sighting(124, 1.0, 0.0),)),
    )
    assert estimation.update(beliefs, WALK, SENSOR, rubbish) is beliefs


@EITHER
def test_a_track_coasts_with_growing_doubt_and_is_dropped(settings: FilterSettings) -> None:
    settings = replace(settings, drop_after_s=2.0)
    beliefs = estimation.with_prior(
        estimation.start(IDS, settings), 124, (1.0, 1.0), ((0.1, 0.0), (0.0, 0.1))
    )
    traces = []
    for _ in range(4):
        beliefs = estimation.predict(beliefs, settings, 0.5)
        traces.append(estimation.trace(beliefs))
    assert traces == sorted(traces)
    assert beliefs.status(1.0) == (
        TrackStatus.UNKNOWN,
        TrackStatus.COASTING,
        TrackStatus.UNKNOWN,
    )
    beliefs = estimation.predict(beliefs, settings, 0.5)
    assert beliefs.status(1.0)[1] is TrackStatus.DROPPED
    assert estimation.trace(beliefs) == 0.0
    again = seen((0.0, 0.0), {124: (4.0, 4.0)}, np.zeros((1, 2)))
    beliefs = estimation.update(beliefs, settings, SENSOR, (again,))
    assert beliefs.status(1.0)[1] is TrackStatus.TRACKED


@EITHER
@given(count=st.integers(1, 4), step=st.floats(0.05, 1.0))
def test_forecast_is_repeated_prediction(settings: FilterSettings, count: int, step: float) -> None:
    beliefs = known(settings)
    if settings is CRUISE:
        beliefs = replace(beliefs, means=beliefs.means + np.array([0.0, 0.0, 0.3, -0.1]))
    means, priors, growth = estimation.forecast(beliefs, settings, step, count)
    assert means.shape == (count, 3, 2)
    covariance = priors
    for k in range(count):
        beliefs = estimation.predict(beliefs, settings, step)
        if k:
            covariance = covariance + growth[k]
        np.testing.assert_allclose(means[k], beliefs.means[:, :2], atol=1e-12)
        np.testing.assert_allclose(
            covariance, estimation.position_covariances(beliefs), rtol=1e-9, atol=1e-12
        )


def test_a_prior_must_be_one() -> None:
    beliefs = estimation.start(IDS, WALK)
    with pytest.raises(ValueError, match="covariance > 0"):
        estimation.with_prior(beliefs, 122, (0.0, 0.0), ((1.0, 0.0), (0.0, -1.0)))
    with pytest.raises(ValueError, match="covariance > 0"):
        estimation.with_prior(beliefs, 122, (0.0, 0.0), ((1e-320, 0.0), (0.0, 1e-320)))
    with pytest.raises(KeyError, match="no target 7"):
        estimation.with_prior(beliefs, 7, (0.0, 0.0), ((1.0, 0.0), (0.0, 1.0)))


def test_no_targets_at_all() -> None:
    beliefs = estimation.predict(estimation.start((), WALK), WALK, 0.1)
    beliefs = estimation.update(
        beliefs, WALK, SENSOR, (Detections(1, (0.0, 0.0), (Sighting(1, 1.0, 0.0),)),)
    )
    means, priors, growth = estimation.forecast(beliefs, WALK, 0.1, 3)
    assert (means.shape, priors.shape, growth.shape) == ((3, 0, 2), (0, 2, 2), (3, 0, 2, 2))
    assert estimation.trace(beliefs) == 0.0
