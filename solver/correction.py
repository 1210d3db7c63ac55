"""One moment's sightings of many targets, fused with where the targets were expected.

The maximum of the posterior is found by damped Gauss-Newton steps (the iterated extended
Kalman filter: Bell and Cathey, 1993), all targets at once. Each step must lower
`(x - m)' P^-1 (x - m) + sum nu' R^-1 nu`, so that a bearing from close by, where one straight
line is no model of it, cannot throw a target away: robots are sent to such places.
"""

import math

import numpy as np

from solver import matrices
from solver.arrays import FloatArray, IntArray
from solver.problem import SensorModel
from solver.sensing import LEAST_PRECISION, TARGET_FLOOR_M, wrapped

_SMALL_STEP = 1e-4
"""Square of a step that changes nothing any more, in units of the posterior's trace."""


class SightingSet:
    """S sightings of T different targets.

    Args:
        means: (N, 2) expected positions of all targets.
        prior: (N, 2, 2) their covariances.
        sensor: The sensor; its noise is taken at the expected distances.
        sightings: (S, 5) columns: target row, robot x, robot y, range, bearing.
    """

    def __init__(
        self, means: FloatArray, prior: FloatArray, sensor: SensorModel, sightings: FloatArray
    ) -> None:
        sightings = sightings[np.argsort(sightings[:, 0], kind="stable")]
        rows = sightings[:, 0].astype(np.int64)
        first = np.ones(len(rows), dtype=np.bool_)
        first[1:] = rows[1:] != rows[:-1]
        self._starts, self._index = np.flatnonzero(first), first.cumsum() - 1
        self.targets = rows[self._starts]
        """(T,) rows of the targets sighted, ascending; results are in this order."""

        self._means, self._prior = means[self.targets], prior[self.targets]
        self.precision = matrices.inverse(self._prior)
        """(T, 2, 2) P^-1."""

        self._robot_x, self._robot_y = sightings[:, 1], sightings[:, 2]
        self._range, self._bearing = sightings[:, 3], sightings[:, 4]
        self._table = np.empty((len(sightings), 6))
        dx, dy = self._offsets(self._means)
        rho = np.sqrt(dx * dx + dy * dy + TARGET_FLOOR_M**2)
        self._w_range = sensor.range_peak * np.exp(-sensor.range_shape * rho)
        self._w_bearing = sensor.bearing_peak * np.exp(-sensor.bearing_shape * rho)
        self._at_means = self._tangent(self._means)

    def gated(self, probability: float | None) -> tuple[IntArray, IntArray]:
        """Leave out sightings beyond a quantile of their Mahalanobis distance.

        Returns:
            How many sightings of each target were accepted and rejected, (T,) each.
        """
        total = np.bincount(self._index)
        if probability is None:
            return total, np.zeros_like(total)
        hx, hy, bx, by, nu_range, nu_bearing = self._at_means
        P = self._prior[self._index]
        a, b, c = P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]
        R_range = 1.0 / np.maximum(self._w_range, LEAST_PRECISION)
        R_bearing = 1.0 / np.maximum(self._w_bearing, LEAST_PRECISION)
        s11 = a * hx * hx + 2.0 * b * hx * hy + c * hy * hy + R_range
        s22 = a * bx * bx + 2.0 * b * bx * by + c * by * by + R_bearing
        s12 = a * hx * bx + b * (hx * by + hy * bx) + c * hy * by
        distance = nu_range**2 * s22 - 2.0 * nu_range * nu_bearing * s12 + nu_bearing**2 * s11
        # Chi-square with two degrees of freedom: P(d < t) = 1 - exp(-t/2).
        limit = -2.0 * math.log1p(-probability)
        accepted = distance <= limit * (s11 * s22 - s12 * s12)
        if accepted.all():
            return total, np.zeros_like(total)
        self._w_range = self._w_range * accepted
        self._w_bearing = self._w_bearing * accepted
        hits = np.add.reduceat(accepted.astype(np.int64), self._starts)
        return hits, total - hits

    def fused(self, refinements: int) -> tuple[FloatArray, FloatArray]:
        """Return posterior position covariances (T, 2, 2) and shifts of the means (T, 2)."""
        shift = np.zeros_like(self._means)
        price, gain, pull = self._linearised(shift, self._at_means)
        covariance = matrices.inverse(self.precision + gain)
        step = (covariance @ pull[:, :, None])[:, :, 0]
        if refinements == 0:
            return covariance, step
        share = np.ones((len(shift), 1))
        for _ in range(refinements):
            trial = shift + share * step
            trial_price, trial_gain, trial_pull = self._linearised(
                trial, self._tangent(self._means + trial)
            )
            better = trial_price <= price
            if better.all():
                shift, price, gain, pull = trial, trial_price, trial_gain, trial_pull
            else:
                shift = np.where(better[:, None], trial, shift)
                price = np.where(better, trial_price, price)
                gain = np.where(better[:, None, None], trial_gain, gain)
                pull = np.where(better[:, None], trial_pull, pull)
            share = np.where(better[:, None], 1.0, 0.5 * share)
            covariance = matrices.inverse(self.precision + gain)
            step = (covariance @ pull[:, :, None])[:, :, 0]
            length = (step * step).sum(axis=1)
            if (length <= _SMALL_STEP * (covariance[:, 0, 0] + covariance[:, 1, 1])).all():
                break
        return covariance, shift

    def _offsets(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, y = positions[self._index].T
        return x - self._robot_x, y - self._robot_y

    def _tangent(self, positions: FloatArray) -> tuple[FloatArray, ...]:
        """Return rows of H, d'/rho and (Jd)'/rho^2 with d = target - robot, and residuals."""
        dx, dy = self._offsets(positions)
        squared = dx * dx + dy * dy
        floored = squared + TARGET_FLOOR_M**2
        rho = np.sqrt(floored)
        nu_range = self._range - np.sqrt(squared)
        nu_bearing = wrapped(self._bearing - np.arctan2(dy, dx))
        return dx / rho, dy / rho, -dy / floored, dx / floored, nu_range, nu_bearing

    def _linearised(
        self, shift: FloatArray, tangent: tuple[FloatArray, ...]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return price (T,), summed information (T, 2, 2) and pull (T, 2) at shifted means."""
        hx, hy, bx, by, nu_range, nu_bearing = tangent
        w, v, table = self._w_range, self._w_bearing, self._table
        whx, vbx = w * hx, v * bx
        r, s = w * nu_range, v * nu_bearing
        table[:, 0] = whx * hx + vbx * bx
        table[:, 1] = whx * hy + vbx * by
        table[:, 2] = w * hy * hy + v * by * by
        table[:, 3] = r * hx + s * bx
        table[:, 4] = r * hy + s * by
        table[:, 5] = r * nu_range + s * nu_bearing
        summed = np.add.reduceat(table, self._starts, axis=0)
        gain = summed[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        back = (self.precision @ shift[:, :, None])[:, :, 0]
        return (back * shift).sum(axis=1) + summed[:, 5], gain, summed[:, 3:5] - back
