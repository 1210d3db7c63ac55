"""Where the targets are believed to be: one extended Kalman filter over all of them.

All N targets are filtered at once on stacked arrays. A state is (x, y) under the random walk
and (x, y, vx, vy) at constant velocity. Measurements touch positions only, so an update works
on the position marginal and carries the result to the velocities by regression, `Pvx Pxx^-1`:
equal to the textbook update, and positive definite by construction. Sightings from afar are
fused in information form (`solver.evidence`), near ones one after another
(`solver.nearfield`).
"""

from dataclasses import replace

import numpy as np

from solver import evidence, initiation, matrices, nearfield
from solver.arrays import BoolArray, FloatArray
from solver.beliefs import (
    GREATEST_VARIANCE,
    LEAST_VARIANCE,
    Beliefs,
    FilterSettings,
    MotionModel,
    NearField,
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
from solver.sightings import Sightings, gathered, layers

__all__ = [
    "Beliefs",
    "FilterSettings",
    "MotionModel",
    "NearField",
    "forecast",
    "fuse",
    "position_covariances",
    "predict",
    "start",
    "trace",
    "update",
    "with_prior",
]

REACQUIRE_AFTER_S = 1.0
"""A track that nothing confirmed for so long, and whose sightings were all rejected ..."""

REACQUIRE_SIGHTINGS = 3
"""... at least so many in a row, is given up and started afresh from them."""


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

    Outliers are gated one sighting at a time. An unknown target's track starts from its most
    precise sighting, and so does that of a target whose sightings have all been rejected for
    a while: then the track is wrong, not the robots. Sightings of unknown ids and with numbers
    that are not ordinary (NaN, infinite, beyond `solver.sightings.FARTHEST`) are ignored.
    """
    sightings = gathered(beliefs.ids, batch)
    if not len(sightings):
        return beliefs
    beliefs = _started_and_fused(beliefs, settings, sensor, sightings)
    lost = (beliefs.rejected >= REACQUIRE_SIGHTINGS) & (beliefs.unseen_s >= REACQUIRE_AFTER_S)
    again = lost[sightings.rows]
    if again.any():
        lost = np.zeros_like(lost)
        lost[sightings.rows[again]] = True
        beliefs = replace(beliefs, known=beliefs.known & ~lost)
        beliefs = _started_and_fused(beliefs, settings, sensor, sightings.select(again))
    return beliefs


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


def _started_and_fused(
    beliefs: Beliefs, settings: FilterSettings, sensor: SensorModel, sightings: Sightings
) -> Beliefs:
    if not beliefs.known[sightings.rows].all():
        beliefs, used = initiation.started(beliefs, settings, sensor, sightings)
        sightings = sightings.select(~used)
        if not len(sightings):
            return beliefs
    return _fused(beliefs, settings, sensor, sightings)


def _fused(
    beliefs: Beliefs, settings: FilterSettings, sensor: SensorModel, sightings: Sightings
) -> Beliefs:
    """Fuse sightings of known targets: those from afar at once, then near ones by turns."""
    count = len(beliefs.ids)
    means, P = beliefs.means, beliefs.covariances
    prior = P[:, :2, :2]
    accepted = np.zeros(len(sightings), dtype=np.bool_)
    near = evidence.near(sightings, means, prior)
    inverse = matrices.inverse(prior)
    position, moved = prior, np.zeros((count, 2, 1))
    if not near.all():
        information, vector, accepted[~near] = evidence.gathered(
            sightings.select(~near), sensor, means, prior, settings.gate_probability
        )
        position = matrices.inverse(inverse + information)
        moved = position @ vector
    if near.any():
        position = matrices.clamped(position, LEAST_VARIANCE, GREATEST_VARIANCE).copy()
        accepted[near] = _sharpened(
            means, moved, position, settings, sensor, sightings.select(near)
        )
    if P.shape[-1] == 2:
        posterior = matrices.clamped(position, LEAST_VARIANCE, GREATEST_VARIANCE)
        shift = moved[:, :, 0]
    else:
        regression = np.swapaxes(P[:, :2, 2:], 1, 2) @ inverse
        posterior = recombined(position, regression, velocity_rest(P, regression))
        shift = np.concatenate((moved, regression @ moved), axis=1)[:, :, 0]
    sighted = np.bincount(sightings.rows, None, count)
    seen = np.bincount(sightings.rows, accepted, count) > 0
    if not seen.all():
        posterior = np.where(seen[:, None, None], posterior, P)
    return replace(
        beliefs,
        means=means + shift,
        covariances=posterior,
        unseen_s=np.where(seen, 0.0, beliefs.unseen_s),
        rejected=np.where(seen, 0, beliefs.rejected + sighted),
    )


def _sharpened(
    means: FloatArray,
    moved: FloatArray,
    position: FloatArray,
    settings: FilterSettings,
    sensor: SensorModel,
    sightings: Sightings,
) -> BoolArray:
    """Fuse near sightings into `moved` (N, 2, 1) and `position` (N, 2, 2), which are changed.

    Returns:
        Which of the sightings were accepted.
    """
    accepted = np.ones(len(sightings), dtype=np.bool_)
    at_mode = settings.near_field is NearField.MODE
    posterior = nearfield.mode if at_mode else nearfield.moments
    for layer in layers(sightings):
        chosen = sightings.select(layer)
        rows = chosen.rows
        expected = means[rows, :2] + moved[rows, :, 0]
        result = posterior(chosen, sensor, expected, position[rows])
        within = np.ones(len(rows), dtype=np.bool_)
        if settings.gate_probability is not None:
            within = result.surprise <= evidence.gate(settings.gate_probability)
            accepted[layer] = within
        rows = rows[within]
        moved[rows, 0, 0] = chosen.x[within] + result.means[within, 0] - means[rows, 0]
        moved[rows, 1, 0] = chosen.y[within] + result.means[within, 1] - means[rows, 1]
        position[rows] = matrices.clamped(
            result.covariances[within], LEAST_VARIANCE, GREATEST_VARIANCE
        )
    return accepted
