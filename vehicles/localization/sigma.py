"""filterpy's unscented filter for many calls a second: whole sets of sigma points at a time.

filterpy calls the models once per sigma point. At 150 Hz and 39 points that is most of the time,
so here the models take all points at once; the algebra stays filterpy's.
"""

from collections.abc import Callable, Iterator

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter, unscented_transform

from solver.arrays import FloatArray

ALPHA, BETA = 0.5, 2.0
"""Spread of the points, and what is best for a Gaussian."""

FLOOR = 1e-14
"""Least variance a damaged covariance is repaired to."""

Model = Callable[[FloatArray], FloatArray]
"""States of all sigma points (m, n) to what is modelled of them (m, k)."""


class SigmaPoints(MerweScaledSigmaPoints):  # type: ignore[misc]
    """Scaled sigma points, drawn at once.

    Args:
        n: Dimension of the state.
    """

    def __init__(self, n: int) -> None:
        super().__init__(n, alpha=ALPHA, beta=BETA, kappa=0.0)
        self._scale = ALPHA * ALPHA * n

    def sigma_points(self, x: FloatArray, P: FloatArray) -> FloatArray:
        """Return the points (2 n + 1, n) of a mean and a covariance."""
        spread = root(self._scale * P).T
        return np.concatenate((x[None], x + spread, x - spread))


def root(covariance: FloatArray) -> FloatArray:
    """Return a lower triangular root; one that has lost definiteness is repaired first."""
    try:
        return np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
        repaired = (vectors * np.maximum(values, FLOOR)) @ vectors.T
        return np.asarray(np.linalg.cholesky(repaired), dtype=np.float64)


class UnscentedFilter(UnscentedKalmanFilter):  # type: ignore[misc]
    """An unscented filter whose models take all sigma points at once.

    Args:
        n: Dimension of the state.
    """

    x: FloatArray
    P: FloatArray
    sigmas_f: FloatArray

    def __init__(self, n: int) -> None:
        super().__init__(n, 1, 1.0, None, None, SigmaPoints(n))

    def compute_process_sigmas(self, dt: float, fx: Model, **fx_args: object) -> None:
        """Move all sigma points by one step of the process."""
        self.sigmas_f = fx(self.points_fn.sigma_points(self.x, self.P))

    def cross_variance(
        self, x: FloatArray, z: FloatArray, sigmas_f: FloatArray, sigmas_h: FloatArray
    ) -> FloatArray:
        """Return the covariance of state and measurement, shape (n, k)."""
        weighted: FloatArray = self.Wc[:, None] * (sigmas_h - z)
        return (sigmas_f - x).T @ weighted

    def transform(self, model: Model, noise: FloatArray) -> None:
        """Pass the state itself through a model: another parametrisation of the same belief."""
        points = model(self.points_fn.sigma_points(self.x, self.P))
        self.x, self.P = unscented_transform(points, self.Wm, self.Wc, noise)
        self.refresh()

    def refresh(self) -> None:
        """Draw the sigma points anew after the state has been changed."""
        self.P = 0.5 * (self.P + self.P.T)
        self.sigmas_f = self.points_fn.sigma_points(self.x, self.P)

    def absorb(self, z: FloatArray, noise: FloatArray, model: Model, gate: float) -> bool:
        """Take a measurement unless it is an outlier.

        Args:
            z: Measurement (k,).
            noise: Its covariance (k, k).
            model: Of the measurement.
            gate: Squared Mahalanobis distance beyond which it is an outlier.

        Returns:
            Whether it was taken.
        """
        rows = model(self.sigmas_f)
        expected, spread = unscented_transform(rows, self.Wm, self.Wc, noise)
        innovation = z - expected
        if not innovation @ np.linalg.solve(spread, innovation) <= gate:
            return False
        each: Iterator[FloatArray] = iter(rows)
        self._dim_z = len(z)
        self.update(z, R=noise, hx=lambda _: next(each))
        return True
