"""What is believed of the targets, and under which assumptions.

A state is (x, y) under the random walk and (x, y, vx, vy) at constant velocity.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from solver import matrices
from solver.arrays import BoolArray, FloatArray, IntArray
from solver.snapshot import TrackStatus
from solver.zones import Matrix2, Point

LEAST_VARIANCE = 1e-9
"""Least and greatest variance (m^2, and (m/s)^2) that a covariance may have along any axis."""

GREATEST_VARIANCE = 1e9

_LEAST_EIGENVALUE = 1e-150
"""The inverse of a covariance with a smaller one is not finite: its determinant underflows."""


class MotionModel(StrEnum):
    """How targets are believed to move."""

    RANDOM_WALK = "random_walk"
    """Position only, Q = q I dt."""

    CONSTANT_VELOCITY = "constant_velocity"
    """White acceleration of spectral density q on each axis."""


class NearField(StrEnum):
    """What is taken of the posterior where a bearing cannot be linearised."""

    MOMENTS = "moments"
    """Its mean and covariance: errs least if the noise is what the sensor model says."""

    MODE = "mode"
    """Its most likely place: for worlds whose noise is far below the model's."""


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """What the filter takes for granted."""

    model: MotionModel = MotionModel.RANDOM_WALK
    process_noise: float = 0.1
    """q: m^2/s under the random walk, m^2/s^3 at constant velocity."""

    prior_variance: float = 100.0
    """m^2 per axis of a target nobody has seen; only shown, never planned with."""

    gate_probability: float | None = 0.9999
    """A sighting is an outlier beyond this quantile of its Mahalanobis distance; None: no gate."""

    drop_after_s: float = 30.0
    """A track unseen for longer is dropped."""

    speed_variance: float = 0.25
    """(m/s)^2 per axis of a track's velocity when it starts."""

    near_field: NearField = NearField.MOMENTS

    @property
    def dimension(self) -> int:
        """Return the length of a state: 2 or 4."""
        return 4 if self.model is MotionModel.CONSTANT_VELOCITY else 2


@dataclass(frozen=True, slots=True, eq=False)
class Beliefs:
    """All N targets as believed, in mission order. Arrays are not to be written to."""

    ids: tuple[int, ...]
    means: FloatArray
    """(N, d) states; zero where never known."""

    covariances: FloatArray
    """(N, d, d) symmetric positive definite."""

    known: BoolArray
    """(N,) whether there is a track."""

    unseen_s: FloatArray
    """(N,) seconds since the last accepted sighting (or prior, or start)."""

    rejected: IntArray
    """(N,) sightings gated out in a row."""

    started: BoolArray
    """(N,) whether there has ever been a track."""

    def status(self, coast_after_s: float) -> tuple[TrackStatus, ...]:
        """Return how well each target is known; coasting once unseen for the time given."""
        result = []
        for known, started, unseen in zip(
            self.known.tolist(), self.started.tolist(), self.unseen_s.tolist(), strict=True
        ):
            if known:
                coasts = unseen > coast_after_s
                result.append(TrackStatus.COASTING if coasts else TrackStatus.TRACKED)
            else:
                result.append(TrackStatus.DROPPED if started else TrackStatus.UNKNOWN)
        return tuple(result)


def start(ids: tuple[int, ...], settings: FilterSettings) -> Beliefs:
    """Return beliefs in which every target is unknown."""
    count, d = len(ids), settings.dimension
    return Beliefs(
        ids=ids,
        means=np.zeros((count, d)),
        covariances=np.tile(unknown_covariance(settings), (count, 1, 1)),
        known=np.zeros(count, dtype=np.bool_),
        unseen_s=np.zeros(count),
        rejected=np.zeros(count, dtype=np.int64),
        started=np.zeros(count, dtype=np.bool_),
    )


def with_prior(beliefs: Beliefs, target_id: int, mean: Point, covariance: Matrix2) -> Beliefs:
    """Return beliefs in which one target's position is known from elsewhere.

    Its velocity keeps mean and variance and is uncorrelated with the position from now on.

    Raises:
        KeyError: There is no such target.
        ValueError: The mean is not finite or the covariance not positive definite.
    """
    position = np.asarray(covariance, dtype=np.float64)
    if not (np.isfinite(mean).all() and is_covariance(position)):
        raise ValueError(f"prior of target {target_id} needs a finite mean and a covariance > 0")
    try:
        row = beliefs.ids.index(target_id)
    except ValueError:
        raise KeyError(f"no target {target_id}") from None
    means, covariances = beliefs.means.copy(), beliefs.covariances.copy()
    means[row, :2] = mean
    covariances[row, :2, 2:] = 0.0
    covariances[row, 2:, :2] = 0.0
    covariances[row, :2, :2] = matrices.symmetric(position)
    seen = np.zeros(len(beliefs.ids), dtype=np.bool_)
    seen[row] = True
    return replace(
        beliefs,
        means=means,
        covariances=covariances,
        known=beliefs.known | seen,
        started=beliefs.started | seen,
        unseen_s=np.where(seen, 0.0, beliefs.unseen_s),
        rejected=np.where(seen, 0, beliefs.rejected),
    )


def position_covariances(beliefs: Beliefs) -> FloatArray:
    """Return the position covariances, shape (N, 2, 2), m^2."""
    return beliefs.covariances[:, :2, :2]


def trace(beliefs: Beliefs) -> float:
    """Return the sum over known targets of the trace of the position covariance, m^2."""
    P = beliefs.covariances
    return float((P[:, 0, 0] + P[:, 1, 1])[beliefs.known].sum())


def unknown_covariance(settings: FilterSettings) -> FloatArray:
    """Return the covariance of a target that nobody has seen, shape (d, d)."""
    variances = [settings.prior_variance] * 2 + [settings.speed_variance] * 2
    return np.diag(variances[: settings.dimension])


def is_covariance(matrix: FloatArray) -> bool:
    """Return whether a matrix (d, d) is finite, symmetric and positive definite to be inverted."""
    if not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T, rtol=1e-6):
        return False
    return bool(np.linalg.eigvalsh(matrix)[0] > _LEAST_EIGENVALUE)


def bounded(P: FloatArray) -> FloatArray:
    """Return covariances that rounding has not made indefinite and time not infinite."""
    if P.shape[-1] == 2:
        return matrices.clamped(P, LEAST_VARIANCE, GREATEST_VARIANCE)
    position = P[:, :2, :2]
    regression = np.swapaxes(P[:, :2, 2:], 1, 2) @ matrices.inverse(position)
    return recombined(position, regression, velocity_rest(P, regression))


def velocity_rest(P: FloatArray, regression: FloatArray) -> FloatArray:
    """Return the velocity covariance that remains when the position is known."""
    return P[:, 2:, 2:] - regression @ P[:, :2, 2:]


def recombined(position: FloatArray, regression: FloatArray, rest: FloatArray) -> FloatArray:
    """Return (N, 4, 4) covariances with the position marginal given, positive definite."""
    position = matrices.clamped(position, LEAST_VARIANCE, GREATEST_VARIANCE)
    rest = matrices.clamped(matrices.symmetric(rest), LEAST_VARIANCE, GREATEST_VARIANCE)
    P = np.empty((len(position), 4, 4))
    P[:, :2, :2] = position
    lower = regression @ position
    P[:, 2:, :2] = lower
    P[:, :2, 2:] = np.swapaxes(lower, 1, 2)
    P[:, 2:, 2:] = matrices.symmetric(rest + lower @ np.swapaxes(regression, 1, 2))
    return P
