"""Where the targets are believed to be: one extended Kalman filter over all of them.

All N targets are filtered at once on stacked arrays. A state is (x, y) under the random walk
and (x, y, vx, vy) at constant velocity. Measurements touch positions only, so an update works
on the position marginal in information form (`solver.correction`) and carries the result to the
velocities by regression, `Pvx Pxx^-1`: equal to the textbook update, and positive definite by
construction.
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
from solver.correction import SightingSet
from solver.fusion import fuse
from solver.observations import Detections
from solver.problem import SensorModel
from solver.sensing import noise_variances

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

    Linearised at the predicted means and then, `settings.refinements` times, at the better
    ones found; bearing differences wrapped, outliers gated one sighting at a time. An unknown
    target's track starts from its first sighting. Sightings of unknown ids and with numbers
    that are not finite are ignored.
    """
    sightings = _gathered(beliefs.ids, batch)
    if not len(sightings):
        return beliefs
    rows = sightings[:, 0].astype(np.int64)
    if not beliefs.known[rows].all():
        beliefs, started = _initiated(beliefs, settings, sensor, rows, sightings)
        sightings = sightings[~started]
        if not len(sightings):
            return beliefs
    return _updated(beliefs, settings, sensor, sightings)


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
    beliefs: Beliefs, settings: FilterSettings, sensor: SensorModel, sightings: FloatArray
) -> Beliefs:
    """Fuse sightings of known targets."""
    P = beliefs.covariances
    seen_by = SightingSet(beliefs.means[:, :2], P[:, :2, :2], sensor, sightings)
    hits, rejected = seen_by.gated(settings.gate_probability)
    position, shift = seen_by.fused(settings.refinements)
    seen = hits > 0
    targets = seen_by.targets[seen]
    position, shift = position[seen], shift[seen]
    means, covariances = beliefs.means.copy(), P.copy()
    if P.shape[-1] == 2:
        means[targets] += shift
        covariances[targets] = matrices.clamped(position, LEAST_VARIANCE, GREATEST_VARIANCE)
    else:
        before = P[targets]
        regression = np.swapaxes(before[:, :2, 2:], 1, 2) @ seen_by.precision[seen]
        rest = velocity_rest(before, regression)
        covariances[targets] = recombined(position, regression, rest)
        means[targets, :2] += shift
        means[targets, 2:] += (regression @ shift[:, :, None])[:, :, 0]
    unseen, outliers = beliefs.unseen_s.copy(), beliefs.rejected.copy()
    outliers[seen_by.targets] += rejected
    unseen[targets] = 0.0
    outliers[targets] = 0
    return replace(
        beliefs, means=means, covariances=covariances, unseen_s=unseen, rejected=outliers
    )
