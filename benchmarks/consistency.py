"""Monte Carlo runs of the filter over its own model: are errors as large as it claims?

Every run is a target of its own, followed by robots that hover at a set distance from the
estimate, as the optimizer makes them. Truths move exactly as the filter's model says and
sightings are as noisy as its sensor model says, so that whatever is off is the filter's doing.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from solver import estimation
from solver.arrays import FloatArray
from solver.beliefs import Beliefs, FilterSettings, MotionModel, NearField
from solver.observations import Detections, OnboardTrack, Sighting
from solver.problem import SensorModel
from solver.sensing import TARGET_FLOOR_M, variances, wrapped

SENSOR = SensorModel()
FIRST_VARIANCE_M2 = 0.1
_SPEED_VARIANCE = 0.01
_PROCESS_NOISE = {MotionModel.RANDOM_WALK: 0.1, MotionModel.CONSTANT_VELOCITY: 0.02}
_ANGLE_BETWEEN_ROBOTS = 2.2


@dataclass(frozen=True, slots=True)
class Case:
    """What is flown."""

    model: MotionModel
    distance_m: float
    robots: int
    tick_s: float = 0.1
    near_field: NearField = NearField.MOMENTS


@dataclass(frozen=True, slots=True)
class Consistency:
    """What came of it. 1 is what an honest filter has, over many runs."""

    case: Case
    runs: int
    steps: int
    nees: float
    """Mean normalised squared error of the estimate, per dimension."""

    nees_within: float
    """Share of moments whose mean over the runs lies in its 95 % chi-square interval."""

    nis: float
    """Mean normalised squared innovation, per dimension, of the linearised measurements."""

    nis_within: float
    inside: float
    """Share of true places inside the 95 % ellipse claimed."""

    error_m: float
    """Root of the mean squared error of the position."""

    claimed_m: float
    """Root of the mean trace of its covariance."""

    worst_m: float


def filter_settings(case: Case) -> FilterSettings:
    """Return the product's filter with the noise of the case."""
    return FilterSettings(
        model=case.model,
        process_noise=_PROCESS_NOISE[case.model],
        speed_variance=_SPEED_VARIANCE,
        near_field=case.near_field,
        drop_after_s=1e9,
    )


class Truths:
    """States of n targets (n, 2) or (n, 4), moving as the filter's model says."""

    def __init__(self, settings: FilterSettings, runs: int, rng: np.random.Generator) -> None:
        self._settings, self._rng = settings, rng
        self.states = np.sqrt(FIRST_VARIANCE_M2) * rng.normal(size=(runs, 2))
        if settings.model is MotionModel.CONSTANT_VELOCITY:
            speeds = np.sqrt(settings.speed_variance) * rng.normal(size=(runs, 2))
            self.states = np.concatenate((self.states, speeds), axis=1)

    @property
    def places(self) -> FloatArray:
        """(n, 2)."""
        return self.states[:, :2]

    def move(self, dt: float) -> None:
        """One step: Brownian motion, or white acceleration integrated exactly."""
        q, runs = self._settings.process_noise, len(self.states)
        if self._settings.model is MotionModel.RANDOM_WALK:
            self.states = self.states + np.sqrt(q * dt) * self._rng.normal(size=(runs, 2))
            return
        Q = q * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
        kicks = self._rng.normal(size=(runs, 2, 2)) @ np.linalg.cholesky(Q).T
        moved = self.states.copy()
        moved[:, :2] += dt * self.states[:, 2:] + kicks[:, :, 0]
        moved[:, 2:] += kicks[:, :, 1]
        self.states = moved


def first_beliefs(settings: FilterSettings, runs: int) -> Beliefs:
    """Return what is believed of n targets at the start: near the origin."""
    beliefs = estimation.start(tuple(range(runs)), settings)
    prior = ((FIRST_VARIANCE_M2, 0.0), (0.0, FIRST_VARIANCE_M2))
    for target_id in range(runs):
        beliefs = estimation.with_prior(beliefs, target_id, (0.0, 0.0), prior)
    return beliefs


def stations(beliefs: Beliefs, distance_m: float, robots: int, phase: float = 0.3) -> FloatArray:
    """Return where the robots of each run hover, (robots, n, 2)."""
    angles = phase + _ANGLE_BETWEEN_ROBOTS * np.arange(robots)
    around = distance_m * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    return np.asarray(beliefs.means[None, :, :2] + around[:, None])


def measured(robots: FloatArray, targets: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return ranges and bearings (..., n, 2) of targets (n, 2) from robots (..., n, 2)."""
    d = targets - robots
    squared = (d * d).sum(axis=-1)
    along, across = variances(SENSOR, squared)
    ranges = np.sqrt(squared) + np.sqrt(along) * rng.normal(size=squared.shape)
    bearings = np.arctan2(d[..., 1], d[..., 0]) + np.sqrt(across) * rng.normal(size=squared.shape)
    return np.stack((ranges, wrapped(bearings)), axis=-1)


def told(robots: FloatArray, z: FloatArray) -> tuple[Detections, ...]:
    """Return sightings (robots, n, 2) as what the robots send, one message per run and robot."""
    return tuple(
        Detections(i, (x, y), (Sighting(run, distance, bearing),))
        for i, (places, seen) in enumerate(zip(robots.tolist(), z.tolist(), strict=True))
        for run, ((x, y), (distance, bearing)) in enumerate(zip(places, seen, strict=True))
    )


def innovations(beliefs: Beliefs, robots: FloatArray, z: FloatArray) -> FloatArray:
    """Return the normalised squared innovations (n,) of all robots' sightings stacked."""
    d = beliefs.means[None, :, :2] - robots
    squared = (d * d).sum(axis=-1)
    floored = squared + TARGET_FLOOR_M**2
    rows = np.stack(
        (
            d / np.sqrt(floored)[..., None],
            np.stack((-d[..., 1], d[..., 0]), -1) / floored[..., None],
        ),
        axis=-2,
    )
    count, runs = squared.shape
    H = np.moveaxis(rows, 1, 0).reshape(runs, 2 * count, 2)
    along, across = variances(SENSOR, squared)
    R = np.moveaxis(np.stack((along, across), axis=-1), 1, 0).reshape(runs, 2 * count)
    nu = z - np.stack((np.sqrt(squared), np.arctan2(d[..., 1], d[..., 0])), axis=-1)
    nu[..., 1] = wrapped(nu[..., 1])
    nu = np.moveaxis(nu, 1, 0).reshape(runs, 2 * count)
    P = beliefs.covariances[:, :2, :2]
    S = H @ P @ np.swapaxes(H, 1, 2) + R[:, None, :] * np.eye(2 * count)
    return np.asarray((nu * np.linalg.solve(S, nu[:, :, None])[:, :, 0]).sum(axis=1))


def squared_errors(beliefs: Beliefs, states: FloatArray) -> FloatArray:
    """Return normalised squared errors (n,) of the whole state."""
    error = beliefs.means - states
    solved = np.linalg.solve(beliefs.covariances, error[:, :, None])[:, :, 0]
    return np.asarray((error * solved).sum(axis=1))


def flown(
    case: Case, runs: int, steps: int, believed: FilterSettings | None = None, seed: int = 1
) -> Consistency:
    """Follow `runs` targets for `steps` ticks.

    Args:
        case: What is flown.
        runs: Targets, each a run of its own.
        steps: Ticks.
        believed: The filter's settings, if not those that the truth follows.
        seed: Of the one generator.
    """
    rng = np.random.default_rng(seed)
    truths = Truths(filter_settings(case), runs, rng)
    settings = believed or filter_settings(case)
    beliefs = first_beliefs(settings, runs)
    nees, nis, errors, traces, inside = [], [], [], [], []
    for _ in range(steps):
        truths.move(case.tick_s)
        beliefs = estimation.predict(beliefs, settings, case.tick_s)
        robots = stations(beliefs, case.distance_m, case.robots)
        z = measured(robots, truths.places, rng)
        nis.append(innovations(beliefs, robots, z))
        beliefs = estimation.update(beliefs, settings, SENSOR, told(robots, z))
        nees.append(squared_errors(beliefs, truths.states))
        error = beliefs.means[:, :2] - truths.places
        P = estimation.position_covariances(beliefs)
        inside.append((error * np.linalg.solve(P, error[:, :, None])[:, :, 0]).sum(axis=1) < 5.9915)
        errors.append((error * error).sum(axis=1))
        traces.append(P[:, 0, 0] + P[:, 1, 1])
    size = beliefs.means.shape[1]
    return Consistency(
        case=case,
        runs=runs,
        steps=steps,
        nees=float(np.mean(nees)) / size,
        nees_within=share_within(np.array(nees), size),
        nis=float(np.mean(nis)) / (2 * case.robots),
        nis_within=share_within(np.array(nis), 2 * case.robots),
        inside=float(np.mean(inside)),
        error_m=float(np.sqrt(np.mean(errors))),
        claimed_m=float(np.sqrt(np.mean(traces))),
        worst_m=float(np.sqrt(np.max(errors))),
    )


def share_within(squares: FloatArray, size: int) -> float:
    """Return the share of moments (k, n) whose mean over n runs is in its 95 % interval."""
    runs = squares.shape[1]
    low, high = chi2.ppf([0.025, 0.975], size * runs) / runs
    means = squares.mean(axis=1)
    return float(((low <= means) & (means <= high)).mean())


@dataclass(frozen=True, slots=True)
class Reunion:
    """Normalised squared errors per dimension when a robot returns; above 1 is optimistic."""

    apart_s: float
    team: float
    on_board: float
    intersected: float
    """Of what the product makes of both."""

    added: float
    """Of what comes of taking the two for independent."""

    error_team_m: float
    error_m: float
    """Root mean squared error of the position, before and after."""


def reunited(model: MotionModel, apart_s: float, runs: int, seed: int = 2) -> Reunion:
    """Two filters with a common past follow the same targets apart, then meet.

    Their errors are correlated: the past is one, and the targets' random moves are the same.
    """
    rng = np.random.default_rng(seed)
    case = Case(model, 5.0, 1)
    settings = filter_settings(case)
    team, truths, dt = first_beliefs(settings, runs), Truths(settings, runs, rng), case.tick_s
    alone = team
    together, apart = 20, round(apart_s / dt)
    for step in range(together + apart):
        truths.move(dt)
        team = estimation.predict(team, settings, dt)
        robots = stations(team, case.distance_m, 1)
        z = measured(robots, truths.places, rng)
        team = estimation.update(team, settings, SENSOR, told(robots, z))
        if step < together:
            alone = team
            continue
        alone = estimation.predict(alone, settings, dt)
        robots = stations(alone, case.distance_m, 1, phase=1.9)
        z = measured(robots, truths.places, rng)
        alone = estimation.update(alone, settings, SENSOR, told(robots, z))
    brought = tuple(
        OnboardTrack(run, tuple(mean), tuple(map(tuple, covariance)))
        for run, (mean, covariance) in enumerate(
            zip(alone.means.tolist(), alone.covariances.tolist(), strict=True)
        )
    )
    fused = estimation.fuse(team, brought)
    A, B = np.linalg.inv(team.covariances), np.linalg.inv(alone.covariances)
    P = np.linalg.inv(A + B)
    pulled = P @ (A @ team.means[:, :, None] + B @ alone.means[:, :, None])
    added = replace(team, means=pulled[:, :, 0], covariances=P)
    size = team.means.shape[1]

    def normalised(beliefs: Beliefs) -> float:
        return float(squared_errors(beliefs, truths.states).mean()) / size

    def root(beliefs: Beliefs) -> float:
        error = beliefs.means[:, :2] - truths.places
        return float(np.sqrt((error * error).sum(axis=1).mean()))

    return Reunion(
        apart_s=apart_s,
        team=normalised(team),
        on_board=normalised(alone),
        intersected=normalised(fused),
        added=normalised(added),
        error_team_m=root(team),
        error_m=root(fused),
    )
