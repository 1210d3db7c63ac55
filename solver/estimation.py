"""Where the targets are believed to be: one extended Kalman filter over all of them.

All N targets are filtered at once on stacked arrays. A state is (x, y) under the random walk
and (x, y, vx, vy) at constant velocity. Measurements touch positions only, so an update works
on the position marginal in information form and carries the result to the velocities by
regression, `Pvx Pxx^-1`: equal to the textbook update, and positive definite by construction.
"""

import math
from dataclasses import replace

import numpy as np

from solver import matrices
from solver.arrays import BoolArray, FloatArray, IntArray
from solver.beliefs import (
    GREATEST_VARIANCE,
    LEAST_VARIANCE,
    Beliefs,
    FilterSettings,
    MotionModel,
    bounded,
    position_covariances,
    recombined,
    start,
    trace,
    unknown_covariance,
    velocity_rest,
    with_prior,
)
from solver.fusion import fuse
from solver.observations import Detections
from solver.problem import SensorModel
from solver.sensing import LEAST_PRECISION, TARGET_FLOOR_M, noise_variances, wrapped

__all__ = [
    "Beliefs",
    "FilterSettings",
    "MotionModel",
    "forecast",
    "fuse",
    "position_covariances",
    "predict",
    "start",
    "trace",
    "update",
    "with_prior",
]


def predict(beliefs: Beliefs, settings: FilterSettings, dt_s: float) -> Beliefs:
    """Return the beliefs a time later; tracks unseen for too long are dropped.

    Random walk: P + q dt I. Constant velocity: F P F' + Q with the exact discretisation
    of white acceleration.
    """
    known, unseen = beliefs.known, beliefs.unseen_s + dt_s
    alive = known & (unseen <= settings.drop_after_s)
    means, P = beliefs.means, beliefs.covariances
    if settings.model is MotionModel.RANDOM_WALK:
        P = P + (settings.process_noise * dt_s) * np.eye(2)
    else:
        means = means.copy()
        means[:, :2] += dt_s * means[:, 2:]
        P = _moved(P, settings.process_noise, dt_s)
    P = bounded(P)
    if not alive.all():
        # What is not tracked does not move; what has just been dropped knows nothing.
        means = np.where(alive[:, None], means, beliefs.means)
        P = np.where(alive[:, None, None], P, unknown_covariance(settings))
    return replace(beliefs, means=means, covariances=P, known=alive, unseen_s=unseen)


def update(
    beliefs: Beliefs,
    settings: FilterSettings,
    sensor: SensorModel,
    batch: tuple[Detections, ...],
) -> Beliefs:
    """Return the beliefs after one moment's sightings, all targets and robots at once.

    Linearised at the predicted means, bearing differences wrapped, outliers gated one
    sighting at a time. An unknown target's track starts from its first sighting. Sightings of
    unknown ids and with numbers that are not finite are ignored.
    """
    sightings = _gathered(beliefs.ids, batch)
    if not len(sightings):
        return beliefs
    rows = sightings[:, 0].astype(np.int64)
    if not beliefs.known[rows].all():
        beliefs, started = _initiated(beliefs, settings, sensor, rows, sightings)
        rows, sightings = rows[~started], sightings[~started]
        if not len(rows):
            return beliefs
    return _updated(beliefs, settings, sensor, rows, sightings)


def forecast(
    beliefs: Beliefs, settings: FilterSettings, step_s: float, horizon: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what the planner needs to know of the coming `horizon` steps.

    Returns:
        Predicted positions (H, N, 2) at steps 1..H; predicted position covariance
        (N, 2, 2) at step 1; growth (H, N, 2, 2), added to the posterior of step k-1 to
        predict step k (row 0 unused, zero). At constant velocity the growth is the open-loop
        one, in which later measurements do not sharpen the velocity: cautious, and exact
        at one step.
    """
    count = len(beliefs.ids)
    growth = np.zeros((horizon, count, 2, 2))
    if settings.model is MotionModel.RANDOM_WALK:
        noise = settings.process_noise * step_s * np.eye(2)
        growth[1:] = noise
        means = np.broadcast_to(beliefs.means, (horizon, count, 2)).copy()
        return means, beliefs.covariances + noise, growth
    steps = step_s * np.arange(1, horizon + 1)
    means = beliefs.means[:, :2] + steps[:, None, None] * beliefs.means[:, 2:]
    P = _moved(beliefs.covariances, settings.process_noise, step_s)
    priors = P[:, :2, :2].copy()
    for k in range(1, horizon):
        later = _moved(P, settings.process_noise, step_s)
        growth[k] = later[:, :2, :2] - P[:, :2, :2]
        P = later
    return means, priors, matrices.clamped(growth, 0.0, GREATEST_VARIANCE)


def _moved(P: FloatArray, q: float, dt: float) -> FloatArray:
    """Return F P F' + Q at constant velocity, shape (N, 4, 4)."""
    xx, xv, vv = P[:, :2, :2], P[:, :2, 2:], P[:, 2:, 2:]
    identity = np.eye(2)
    moved = np.empty_like(P)
    moved[:, :2, :2] = xx + dt * (xv + np.swapaxes(xv, 1, 2)) + dt * dt * vv
    moved[:, :2, :2] += (q * dt**3 / 3.0) * identity
    cross = xv + dt * vv + (0.5 * q * dt * dt) * identity
    moved[:, :2, 2:] = cross
    moved[:, 2:, :2] = np.swapaxes(cross, 1, 2)
    moved[:, 2:, 2:] = vv + (q * dt) * identity
    return moved


def _gathered(ids: tuple[int, ...], batch: tuple[Detections, ...]) -> FloatArray:
    """Return usable sightings as rows (target row, robot x, robot y, range, bearing)."""
    index = {target_id: row for row, target_id in enumerate(ids)}
    flat = []
    for detections in batch:
        x, y = detections.position
        for sighting in detections.sightings:
            row = index.get(sighting.target_id)
            if row is not None:
                flat.append((row, x, y, sighting.range_m, sighting.bearing_rad))
    table = np.array(flat, dtype=np.float64).reshape(-1, 5)
    usable = np.isfinite(table).all(axis=1)
    return table if usable.all() else table[usable]


def _initiated(
    beliefs: Beliefs,
    settings: FilterSettings,
    sensor: SensorModel,
    rows: IntArray,
    sightings: FloatArray,
) -> tuple[Beliefs, BoolArray]:
    """Start tracks; return the beliefs and which sightings were used up for it.

    The conversion to the plane and its covariance are conditioned on what was measured
    (modified unbiased conversion: Duan, Han and Li, 2004), so that a distant target's track
    is not born overconfident.
    """
    used = np.zeros(len(rows), dtype=np.bool_)
    means, P = beliefs.means.copy(), beliefs.covariances.copy()
    known, unseen = beliefs.known.copy(), beliefs.unseen_s.copy()
    for k, row in enumerate(rows.tolist()):
        if known[row]:
            continue
        _, x, y, measured, bearing = sightings[k].tolist()
        distance = max(measured, 0.0)
        range_variance, bearing_variance = noise_variances(sensor, distance)
        shrink = math.exp(-0.5 * bearing_variance)
        energy = 0.5 * (distance**2 + range_variance)
        along = energy * (1.0 + shrink**4) - (shrink * distance) ** 2
        across = energy * (1.0 - shrink**4)
        c, s = math.cos(bearing), math.sin(bearing)
        turn = np.array([[c, -s], [s, c]])
        P[row] = unknown_covariance(settings)
        P[row, :2, :2] = matrices.symmetric(turn @ np.diag([along, across]) @ turn.T)
        means[row] = 0.0
        means[row, :2] = (x + shrink * distance * c, y + shrink * distance * s)
        known[row] = used[k] = True
        unseen[row] = 0.0
    started = beliefs.started | known
    P = bounded(P)
    return replace(
        beliefs, means=means, covariances=P, known=known, unseen_s=unseen, started=started
    ), used


def _updated(
    beliefs: Beliefs,
    settings: FilterSettings,
    sensor: SensorModel,
    rows: IntArray,
    sightings: FloatArray,
) -> Beliefs:
    """Fuse sightings of known targets."""
    count = len(beliefs.ids)
    means, P = beliefs.means, beliefs.covariances
    prior = P[:, :2, :2]
    # d = target - robot; the rows of H are d'/rho and (Jd)'/rho^2.
    dx = means[rows, 0] - sightings[:, 1]
    dy = means[rows, 1] - sightings[:, 2]
    squared = dx * dx + dy * dy
    floored = squared + TARGET_FLOOR_M**2
    rho = np.sqrt(floored)
    w_range = sensor.range_peak * np.exp(-sensor.range_shape * rho)
    w_bearing = sensor.bearing_peak * np.exp(-sensor.bearing_shape * rho)
    hx, hy = dx / rho, dy / rho
    bx, by = -dy / floored, dx / floored
    nu_range = sightings[:, 3] - np.sqrt(squared)
    nu_bearing = wrapped(sightings[:, 4] - np.arctan2(dy, dx))
    accepted: BoolArray | None = None
    if settings.gate_probability is not None:
        a, b, c = prior[rows, 0, 0], prior[rows, 0, 1], prior[rows, 1, 1]
        s11 = (
            a * hx * hx
            + 2.0 * b * hx * hy
            + c * hy * hy
            + 1.0 / np.maximum(w_range, LEAST_PRECISION)
        )
        s22 = (
            a * bx * bx
            + 2.0 * b * bx * by
            + c * by * by
            + 1.0 / np.maximum(w_bearing, LEAST_PRECISION)
        )
        s12 = a * hx * bx + b * (hx * by + hy * bx) + c * hy * by
        distance = nu_range**2 * s22 - 2.0 * nu_range * nu_bearing * s12 + nu_bearing**2 * s11
        # Chi-square with two degrees of freedom: P(d < t) = 1 - exp(-t/2).
        limit = -2.0 * math.log1p(-settings.gate_probability)
        accepted = distance <= limit * (s11 * s22 - s12 * s12)
        w_range, w_bearing = w_range * accepted, w_bearing * accepted
    gain = np.zeros((count, 2, 2))
    gain[:, 0, 0] = np.bincount(rows, w_range * hx * hx + w_bearing * bx * bx, count)
    gain[:, 1, 1] = np.bincount(rows, w_range * hy * hy + w_bearing * by * by, count)
    gain[:, 0, 1] = np.bincount(rows, w_range * hx * hy + w_bearing * bx * by, count)
    gain[:, 1, 0] = gain[:, 0, 1]
    r, s = w_range * nu_range, w_bearing * nu_bearing
    pull = np.empty((count, 2, 1))
    pull[:, 0, 0] = np.bincount(rows, r * hx + s * bx, count)
    pull[:, 1, 0] = np.bincount(rows, r * hy + s * by, count)
    return _concluded(beliefs, rows, accepted, gain, pull)


def _concluded(
    beliefs: Beliefs,
    rows: IntArray,
    accepted: BoolArray | None,
    gain: FloatArray,
    pull: FloatArray,
) -> Beliefs:
    """Apply the summed information (N, 2, 2) and information vectors (N, 2, 1)."""
    count = len(beliefs.ids)
    hits = np.bincount(rows, accepted, count)
    sightings = np.bincount(rows, None, count)
    seen = hits > 0
    P = beliefs.covariances
    inverse = matrices.inverse(P[:, :2, :2])
    position = matrices.inverse(inverse + gain)
    shift = position @ pull
    if P.shape[-1] == 2:
        posterior = matrices.clamped(position, LEAST_VARIANCE, GREATEST_VARIANCE)
        moved = shift[:, :, 0]
    else:
        regression = np.swapaxes(P[:, :2, 2:], 1, 2) @ inverse
        posterior = recombined(position, regression, velocity_rest(P, regression))
        moved = np.concatenate((shift, regression @ shift), axis=1)[:, :, 0]
    if not seen.all():
        posterior = np.where(seen[:, None, None], posterior, P)
    return replace(
        beliefs,
        means=beliefs.means + moved,
        covariances=posterior,
        unseen_s=np.where(seen, 0.0, beliefs.unseen_s),
        rejected=np.where(seen, 0, beliefs.rejected + sightings),
    )
