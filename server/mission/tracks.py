"""The targets as everybody sees them."""

import numpy as np

from solver import estimation
from solver.arrays import frozen
from solver.beliefs import Beliefs
from solver.snapshot import TrackTable

COASTING_S = 1.0
"""A track unseen for longer is shown as coasting."""


def track_table(beliefs: Beliefs) -> TrackTable:
    """Return the immutable picture of the targets."""
    covariances = estimation.position_covariances(beliefs)
    moving = beliefs.means.shape[1] == 4
    velocities = beliefs.means[:, 2:4] if moving else np.zeros((len(beliefs.ids), 2))
    return TrackTable(
        ids=beliefs.ids,
        positions=frozen(beliefs.means[:, :2]),
        velocities=frozen(velocities),
        covariances=frozen(covariances),
        unseen_s=frozen(beliefs.unseen_s),
        status=beliefs.status(COASTING_S),
    )
