"""Starting tracks from sightings."""

from dataclasses import replace

import numpy as np

from solver import matrices
from solver.arrays import BoolArray
from solver.beliefs import Beliefs, FilterSettings, bounded, unknown_covariance
from solver.problem import SensorModel
from solver.sensing import variances
from solver.sightings import Sightings


def started(
    beliefs: Beliefs, settings: FilterSettings, sensor: SensorModel, sightings: Sightings
) -> tuple[Beliefs, BoolArray]:
    """Start the tracks of unknown targets, each from its most precise sighting.

    The conversion to the plane and its covariance are conditioned on what was measured
    (modified unbiased conversion: Duan, Han and Li, 2004), so that a distant target's track
    is not born overconfident.

    Returns:
        The beliefs, and which sightings were used up (n,).
    """
    used = np.zeros(len(sightings), dtype=np.bool_)
    distance = np.maximum(sightings.range, 0.0)
    range_variance, bearing_variance = variances(sensor, distance * distance)
    shrink = np.exp(-0.5 * bearing_variance)
    energy = distance * distance + range_variance
    # 1/2 (1 + s^4) = 1/2 (1 - s^2)^2 + s^2, written so that nothing cancels.
    along = 0.5 * energy * np.expm1(-bearing_variance) ** 2 + shrink * shrink * range_variance
    across = -0.5 * energy * np.expm1(-2.0 * bearing_variance)
    order = np.lexsort((along + across, sightings.rows))
    order = order[~beliefs.known[sightings.rows[order]]]
    _, first = np.unique(sightings.rows[order], return_index=True)
    best = order[first]
    used[best] = True

    rows = sightings.rows[best]
    c, s = np.cos(sightings.bearing[best]), np.sin(sightings.bearing[best])
    a, b, r = along[best], across[best], (shrink * distance)[best]
    means, P = beliefs.means.copy(), beliefs.covariances.copy()
    means[rows] = 0.0
    means[rows, 0] = sightings.x[best] + r * c
    means[rows, 1] = sightings.y[best] + r * s
    P[rows] = unknown_covariance(settings)
    P[rows, 0, 0] = a * c * c + b * s * s
    P[rows, 1, 1] = a * s * s + b * c * c
    P[rows, 0, 1] = P[rows, 1, 0] = (a - b) * c * s
    P[rows, :2, :2] = matrices.symmetric(P[rows, :2, :2])
    fresh = np.zeros(len(beliefs.ids), dtype=np.bool_)
    fresh[rows] = True
    return replace(
        beliefs,
        means=means,
        covariances=bounded(P),
        known=beliefs.known | fresh,
        started=beliefs.started | fresh,
        unseen_s=np.where(fresh, 0.0, beliefs.unseen_s),
        rejected=np.where(fresh, 0, beliefs.rejected),
    ), used
