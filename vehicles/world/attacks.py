"""When zones hit and when robots recover (paper, section III-B).

Per step, robot and zone the probability of a hit is min(1, density * dt / attack period),
everywhere. A communication zone also hits for certain within delta * spread of its centre
(or delta * sqrt(spread), the law of the paper authors' program), the spread being the
distance to the farthest robot of the team.
"""

import numpy as np

from solver.arrays import BoolArray, FloatArray
from solver.zones import Zone, ZoneKind
from vehicles.world.setup import JammingLaw

AUTHORS_FLOOR = 1e-4
"""The small number their program adds to distances and spreads, metres."""


def hit_probabilities(densities: FloatArray, dt_s: float, attack_period_s: float) -> FloatArray:
    """Return min(1, density * dt / period) elementwise.

    Args:
        densities: (M, Z) density of each zone at each robot, 1/m^2.
        dt_s: Length of the step.
        attack_period_s: Time in which a density of 1 hits once.

    Returns:
        (M, Z) probabilities.
    """
    return np.minimum(1.0, densities * (dt_s / attack_period_s))


def densities(zones: tuple[Zone, ...], positions: FloatArray) -> FloatArray:
    """Return the density of every zone at every robot: (M, Z), 1/m^2."""
    if not zones:
        return np.zeros((len(positions), 0))
    return np.stack([zone.density(positions) for zone in zones], axis=1)


def spreads(positions: FloatArray, law: JammingLaw) -> FloatArray:
    """Return each robot's distance to the farthest robot, as the law counts it: (M,) metres.

    All robots count, those in communication failure too.
    """
    if len(positions) == 0:
        return np.zeros(0)
    offsets = positions[:, None, :] - positions[None, :, :]
    farthest = np.asarray(np.linalg.norm(offsets, axis=2).max(axis=1))
    if law is JammingLaw.AUTHORS:
        # Their floor inside the square root can never bind: the sum is never below it.
        return np.asarray(np.sqrt(farthest + AUTHORS_FLOOR))
    return farthest


def jammed(zones: tuple[Zone, ...], positions: FloatArray, law: JammingLaw) -> BoolArray:
    """Return which robots the spread of the team lets be jammed for certain: (M, Z).

    Always false for sensing zones.
    """
    spread = spreads(positions, law)
    floor = AUTHORS_FLOOR if law is JammingLaw.AUTHORS else 0.0
    answer = np.zeros((len(positions), len(zones)), dtype=np.bool_)
    for column, zone in enumerate(zones):
        if zone.kind is ZoneKind.COMMUNICATION:
            distance = np.linalg.norm(positions - np.asarray(zone.mean), axis=1)
            answer[:, column] = distance + floor < zone.margin * spread
    return answer
