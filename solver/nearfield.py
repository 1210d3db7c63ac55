"""Sightings from so near that a bearing cannot be linearised.

Where a robot is about as near to its target as the target's place is uncertain, it does not
know on which side the target is. Robots are sent to such places, and a filter that puts a
straight line in place of the bearing there is lost sooner or later. Here it is computed what
one sighting (r, b) with variances w and v makes of a prior N(m, P) of the target's offset:

    p(x) ~ N(x; m, P) N(r; |x|, w) N(b; arg x, v)

Along a ray from the robot both the prior and the range's likelihood are Gaussian in the
distance, so that whatever concerns the distance has a closed form. What is left is one
dimension, the direction: equally spaced rays.

`moments` takes the posterior's mean and covariance (assumed density filtering: Maybeck, 1982,
section 12.7). It errs least and knows how much, if the noise is what the sensor model says.
`mode` takes the most likely place and the curvature there, as an iterated extended Kalman
filter does (Bell and Cathey, 1993), which claims more than it knows but is not drawn aside
where the true noise is far below the model's.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from solver import matrices
from solver.arrays import FloatArray, frozen
from solver.problem import SensorModel
from solver.sensing import TARGET_FLOOR_M, information, variances, wrapped
from solver.sightings import Sightings

_RAYS = 13
_STEPS = frozen((2.0 * np.arange(_RAYS) + 1.0 - _RAYS) / _RAYS)
_FINE_RAYS = 61
_FINE_STEPS = frozen((2.0 * np.arange(_FINE_RAYS) + 1.0 - _FINE_RAYS) / _FINE_RAYS)
"""The most likely direction is looked for on as many rays as make a second look needless."""

_HALF_WIDTH = 4.0
"""Standard deviations of the direction that the rays cover to both sides ..."""

_CAUTION = 2.0
"""... whose variance is known roughly only; this factor makes up for it."""

_FARTHEST_BEHIND = -30.0
"""Standard deviations that a ray's Gaussian may lie behind the robot: exp() must not vanish."""

_LEAST_CONDITION = 1e-13
_LEAST_LENGTH_M = 1e-6


@dataclass(frozen=True, slots=True)
class Posterior:
    """What n targets' offsets from the robots that sighted them are believed to be."""

    means: FloatArray
    """(n, 2) m."""

    covariances: FloatArray
    """(n, 2, 2) m^2, positive semidefinite."""

    surprise: FloatArray
    """(n,) least price of any position: squared deviations from prior, range and bearing.

    Where all is linear it is the squared Mahalanobis distance of the innovation.
    """


@dataclass(frozen=True, slots=True)
class _Given:
    """Priors and sightings; every array has the shape (n,)."""

    x: FloatArray
    y: FloatArray
    a: FloatArray
    """Information P^-1 = [[a, b], [b, c]]."""

    b: FloatArray
    c: FloatArray
    range: FloatArray
    bearing: FloatArray
    w: FloatArray
    v: FloatArray
    distance: FloatArray
    """Between robot and target, as expected after the range was measured."""

    spread: FloatArray
    """And its variance."""


@dataclass(frozen=True, slots=True)
class _Rays:
    """Rays (x, y) and what was found along them; every array has the shape (n, rays)."""

    x: FloatArray
    y: FloatArray
    peak: FloatArray
    """The most likely distance, negative behind the robot."""

    deviation: FloatArray
    price: FloatArray
    """Of the place at the peak: squared deviations from prior, range and bearing."""

    @property
    def best(self) -> FloatArray:
        """Return the least price of any place on each ray."""
        behind = np.minimum(self.peak, 0.0) / self.deviation
        return self.price + behind * behind


def moments(
    sightings: Sightings, sensor: SensorModel, means: FloatArray, covariances: FloatArray
) -> Posterior:
    """Return mean and covariance of the posterior of n targets, each given one sighting.

    Args:
        sightings: n of them.
        sensor: Their noise. Nearer than the floor on the distance a bearing tells as little
            as `solver.sensing` has it.
        means: Expected positions (n, 2).
        covariances: Their covariances (n, 2, 2), positive definite.
    """
    given = _prepared(sightings, sensor, means, covariances)
    squared = given.x**2 + given.y**2 + covariances[:, 0, 0] + covariances[:, 1, 1]
    given = replace(given, v=given.v * (1.0 + TARGET_FLOOR_M**2 / squared) ** 2)
    centre, half = _directions(given)
    turned = centre[:, None] + half[:, None] * _STEPS
    rays = _along(_columns(given), turned)
    weight, first, variance = _integrated(rays)
    second = variance + first * first
    x, y = rays.x, rays.y
    east, north = (weight * first * x).sum(axis=1), (weight * first * y).sum(axis=1)
    dx, dy = first * x - east[:, None], first * y - north[:, None]
    # Fewer than two rays in what is left of the directions: at least a ray's own width counts.
    mean_turn = (weight * turned).sum(axis=1, keepdims=True)
    resolved = (weight * (turned - mean_turn) ** 2).sum(axis=1)
    width = (2.0 * half / _RAYS) ** 2 / 12.0
    across = np.maximum(width - resolved, 0.0)[:, None] * second
    P = np.empty((len(east), 2, 2))
    P[:, 0, 0] = (weight * (dx * dx + variance * x * x + across * y * y)).sum(axis=1)
    P[:, 1, 1] = (weight * (dy * dy + variance * y * y + across * x * x)).sum(axis=1)
    P[:, 0, 1] = (weight * (dx * dy + (variance - across) * x * y)).sum(axis=1)
    P[:, 1, 0] = P[:, 0, 1]
    return Posterior(np.stack((east, north), axis=1), P, rays.best.min(axis=1))


def mode(
    sightings: Sightings, sensor: SensorModel, means: FloatArray, covariances: FloatArray
) -> Posterior:
    """Return the most likely offsets of n targets, each given one sighting.

    Arguments as those of `moments`. The covariance is that of the extended Kalman filter
    linearised there. The direction is found to a few thousandths of its standard deviation.
    """
    given = _prepared(sightings, sensor, means, covariances)
    centre, half = _directions(given)
    columns, each = _columns(given), np.arange(len(centre))
    turned = centre[:, None] + half[:, None] * _FINE_STEPS
    price = _along(columns, turned).best
    least = np.minimum(np.maximum(price.argmin(axis=1), 1), _FINE_RAYS - 2)
    left, middle, right = (price[each, least + k] for k in (-1, 0, 1))
    # The least point of a parabola through three rays.
    bend = np.maximum(left - 2.0 * middle + right, _LEAST_CONDITION)
    shift = np.minimum(np.maximum(0.5 * (left - right) / bend, -1.0), 1.0)
    centre = turned[each, least] + (2.0 / _FINE_RAYS) * half * shift
    found = _along(columns, centre[:, None])
    distance = np.maximum(found.peak, 0.0)
    offsets = np.concatenate((distance * found.x, distance * found.y), axis=1)
    P = matrices.inverse(matrices.inverse(covariances) + information(sensor, offsets))
    return Posterior(offsets, P, found.best[:, 0])


def _prepared(
    sightings: Sightings, sensor: SensorModel, means: FloatArray, covariances: FloatArray
) -> _Given:
    """Return priors and sightings, with the noise at the distance that both make likely."""
    x, y = means[:, 0] - sightings.x, means[:, 1] - sightings.y
    trace = covariances[:, 0, 0] + covariances[:, 1, 1]
    expected, measured = np.hypot(x, y), np.maximum(sightings.range, 0.0)
    w, _ = variances(sensor, measured * measured)
    share = trace / (trace + 2.0 * w)
    distance = expected + share * (measured - expected)
    w, v = variances(sensor, distance * distance)
    precision = matrices.inverse(covariances)
    a, b, c = precision[:, 0, 0], precision[:, 0, 1], precision[:, 1, 1]
    return _Given(
        x, y, a, b, c, sightings.range, sightings.bearing, w, v, distance, spread=share * w
    )


def _directions(given: _Given) -> tuple[FloatArray, FloatArray]:
    """Return centre, relative to the bearing, and half width of the directions that count, rad.

    Taken from the measured point fused with the prior in the plane, roughly.
    """
    along = 1.0 / given.w
    across = 1.0 / (given.v * (given.distance**2 + given.spread))
    c, s = np.cos(given.bearing), np.sin(given.bearing)
    a = given.a + along * c * c + across * s * s
    d = given.c + along * s * s + across * c * c
    b = given.b + (along - across) * c * s
    measured = along * np.maximum(given.range, 0.0)
    hx = given.a * given.x + given.b * given.y + measured * c
    hy = given.b * given.x + given.c * given.y + measured * s
    determinant = np.maximum(a * d - b * b, _LEAST_CONDITION * (a + d) ** 2)
    x, y = (d * hx - b * hy) / determinant, (a * hy - b * hx) / determinant
    length = np.hypot(x, y)
    astride = length < _LEAST_LENGTH_M
    length = np.maximum(length, _LEAST_LENGTH_M)
    x, y = np.where(astride, c, x / length), np.where(astride, s, y / length)
    # Variance of the direction: n'Qn over the squared distance, n across the line of sight.
    fused = (d * y * y + 2.0 * b * x * y + a * x * x) / (determinant * length * length)
    centre = wrapped(np.arctan2(y, x) - given.bearing) * given.v / (given.v + fused)
    deviation = np.sqrt(_CAUTION * given.v * fused / (given.v + fused))
    return centre, np.minimum(_HALF_WIDTH * deviation, math.pi)


def _columns(given: _Given) -> FloatArray:
    """Return what `_along` asks of each sighting, (12, n, 1); bearings are the first."""
    a, b, c, x, y = given.a, given.b, given.c, given.x, given.y
    determinant = np.maximum(a * c - b * b, 0.0)
    told = (given.bearing, x, y, a, 2.0 * b, c, determinant, given.range, 1.0 / given.w)
    return np.stack((*told, 1.0 / given.v, a * x + b * y, b * x + c * y))[:, :, None]


def _along(columns: FloatArray, turned: FloatArray) -> _Rays:
    """Return what is found along rays turned (n, rays) from the bearings, rad."""
    bearing, mx, my, a, b2, c, determinant, measured, along, across, hx, hy = columns
    angle = bearing + turned
    x, y = np.cos(angle), np.sin(angle)
    # The prior along the ray: precision q about the distance h / q, and what is left aside.
    q = np.maximum((a * x + b2 * y) * x + c * y * y, _LEAST_CONDITION * (a + c))
    h = x * hx + y * hy
    precision = q + along
    off = x * my - y * mx
    short = h - q * measured
    price = (determinant * off * off + short * short * along / precision) / q
    turn = wrapped(turned)
    return _Rays(
        x,
        y,
        (h + along * measured) / precision,
        1.0 / np.sqrt(precision),
        price + across * turn * turn,
    )


def _integrated(rays: _Rays) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return each ray's share in the posterior, and mean and variance of the distance along it.

    The integrand is a Gaussian times the distance (the area of a strip between two rays grows
    with it), over distances above zero. With t = peak / deviation its integral is
    `t Phi(t) + phi(t)`, up to a factor.
    """
    deviation = rays.deviation
    t = np.maximum(rays.peak / deviation, _FARTHEST_BEHIND)
    below = ndtr(t)
    mass = t * below + np.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi)
    log_share = -0.5 * rays.price + np.log(mass * deviation * deviation)
    share = np.exp(log_share - log_share.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    ratio = below / mass
    variance = deviation * deviation * np.clip(2.0 - ratio * (t + ratio), 1e-6, 1.0)
    return share, deviation * (t + ratio), variance
