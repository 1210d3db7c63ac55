"""A scene to predict: two robots, one zone that only the first of them knows."""

import numpy as np

from server.gate.rollout import Scene
from solver.arrays import frozen, frozen_bool
from tests.server.builders import mission_setup, sensing_zone


def scene() -> Scene:
    """Return the scene."""
    return Scene(
        setup=mission_setup(),
        positions=frozen(np.zeros((0, 2))),
        drift=frozen(np.zeros((0, 2))),
        covariances=frozen(np.zeros((0, 2, 2))),
        blind=frozen_bool([False, False]),
        absent=frozen(np.zeros((0, 2))),
        zones=(sensing_zone(),),
        known=frozen_bool([[True], [False]]),
        tick_s=0.1,
    )
