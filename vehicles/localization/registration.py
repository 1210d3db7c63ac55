"""How an odometry frame lies in the common frame, from sightings of tags whose places are known.

Both frames are level, so four numbers are sought: a shift t and a turn psi about the vertical,
`x_common = R_z(psi) x_odometry + t`. Every pair of sightings of tags that lie apart proposes one;
the proposal that most sightings agree with is refined over those, each weighted by its inverse
covariance (Gauss-Newton), and the inverse of the information is the covariance.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import chdtri

from solver.arrays import BoolArray, FloatArray, IntArray
from vehicles.localization import rotations
from vehicles.localization.measurements import Odometry, TagSighting
from vehicles.mavlink.frames import Alignment

MAX_PAIRS = 400
"""Proposals tried; more pairs are thinned out evenly."""

LEAST_SPREAD_M = 0.3
"""Tags seen closer together tell no direction."""

AGREE_PROBABILITY = 0.99
"""A sighting agrees when it lies inside the ellipsoid of this probability."""

LEAST_AGREEING = 3
LEAST_PART = 0.5
"""Part of the sightings that must agree."""

_ROUNDS = 20


class RegistrationError(ValueError):
    """Raised when the sightings do not tell how the frames lie."""


@dataclass(frozen=True, slots=True)
class Landmark:
    """One sighting of a tag whose place is known."""

    common: FloatArray
    """Place of the tag in the common frame, shape (3,)."""

    odometry: FloatArray
    """Where it was seen in the odometry frame, shape (3,)."""

    covariance: FloatArray
    """Of where it was seen, odometry frame, shape (3, 3)."""


@dataclass(frozen=True, slots=True)
class Registration:
    """How the odometry frame lies in the common frame, and how sure that is."""

    alignment: Alignment
    covariance: FloatArray
    """Of (east, north, up, psi), shape (4, 4), m and rad."""

    agreeing: tuple[bool, ...]
    """Which sightings agree with it."""

    def spread_m(self, odometry: FloatArray) -> float:
        """Return the standard deviation of where it puts a place of the odometry frame (3,)."""
        c, s = np.cos(self.alignment.yaw_rad), np.sin(self.alignment.yaw_rad)
        swing = np.array([-s * odometry[0] - c * odometry[1], c * odometry[0] - s * odometry[1]])
        jacobian = np.eye(3, 4)
        jacobian[:2, 3] = swing
        return float(np.sqrt(np.trace(jacobian @ self.covariance @ jacobian.T)))


def landmark(
    sighting: TagSighting,
    odometry: Odometry,
    odometry_variance: float,
    places: Mapping[int, Sequence[float]],
) -> Landmark | None:
    """Return a sighting as a landmark, None for a tag whose place is not known.

    Args:
        sighting: From the body.
        odometry: Where the body was.
        odometry_variance: Of each of its coordinates, m^2.
        places: Places of the known tags in the common frame, by id.
    """
    place = places.get(sighting.tag_id)
    if place is None:
        return None
    turn = rotations.matrix_of(odometry.attitude)
    return Landmark(
        common=np.asarray(place, dtype=np.float64),
        odometry=odometry.position + turn @ sighting.offset,
        covariance=turn @ sighting.covariance @ turn.T + odometry_variance * np.eye(3),
    )


def register(landmarks: Iterable[Landmark]) -> Registration:
    """Return how the frames lie.

    Raises:
        RegistrationError: Too few sightings, too close together, or they contradict each other.
    """
    seen = tuple(landmarks)
    if len(seen) < LEAST_AGREEING:
        raise RegistrationError(f"{len(seen)} sightings are too few: {LEAST_AGREEING} are needed")
    common = np.array([mark.common for mark in seen])
    odometry = np.array([mark.odometry for mark in seen])
    weights: FloatArray = np.linalg.inv(np.array([mark.covariance for mark in seen]))
    state, agreeing = _consensus(common, odometry, weights)
    for _ in range(_ROUNDS):
        _check(common, agreeing)
        state, covariance = _refined(common[agreeing], odometry[agreeing], weights[agreeing], state)
        again = _agreeing(common, odometry, weights, state)
        if (again == agreeing).all():
            break
        agreeing = again
    _check(common, agreeing)
    east, north, up, psi = (float(number) for number in state)
    return Registration(
        Alignment((east, north, up), psi), covariance, tuple(bool(a) for a in agreeing)
    )


def _check(common: FloatArray, agreeing: BoolArray) -> None:
    """Refuse an agreement of too few, or of sightings of one place only."""
    count = int(agreeing.sum())
    if count < max(LEAST_AGREEING, LEAST_PART * len(common)):
        raise RegistrationError(f"only {count} of {len(common)} sightings agree")
    east, north, _ = np.ptp(common[agreeing], axis=0)
    if np.hypot(east, north) < LEAST_SPREAD_M:
        raise RegistrationError("the tags that agree lie too close together to tell a direction")


def _consensus(
    common: FloatArray, odometry: FloatArray, weights: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return the proposal most sightings agree with, and which do."""
    pairs = np.array(list(combinations(range(len(common)), 2)))
    apart = np.hypot(*(common[pairs[:, 0]] - common[pairs[:, 1]])[:, :2].T)
    pairs = pairs[apart >= LEAST_SPREAD_M]
    if not len(pairs):
        raise RegistrationError("the tags seen lie too close together to tell a direction")
    pairs = pairs[:: -(-len(pairs) // MAX_PAIRS)]
    limit = float(chdtri(3, 1.0 - AGREE_PROBABILITY))
    shifts, psis = _proposals(common, odometry, pairs)
    expected = _turned_back(common - shifts[:, None, :], psis[:, None])
    off = odometry - expected
    distances = np.einsum("pni,nij,pnj->pn", off, weights, off)
    best = int(np.minimum(distances, limit).sum(axis=1).argmin())
    # A proposal of two noisy sightings lies off by their noise: judge with some patience.
    return np.array([*shifts[best], psis[best]]), distances[best] <= 4.0 * limit


def _proposals(
    common: FloatArray, odometry: FloatArray, pairs: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the shifts (p, 3) and turns (p,) that best join each pair of places."""
    there = common[pairs[:, 1]] - common[pairs[:, 0]]
    here = odometry[pairs[:, 1]] - odometry[pairs[:, 0]]
    psis = np.arctan2(there[:, 1], there[:, 0]) - np.arctan2(here[:, 1], here[:, 0])
    middles = odometry[pairs].mean(axis=1)
    shifts = common[pairs].mean(axis=1) - _turned_back(middles, -psis)
    return shifts, psis


def _turned_back(vectors: FloatArray, psi: FloatArray) -> FloatArray:
    """Return R_z(psi)' v over any leading axes."""
    c, s = np.cos(psi), np.sin(psi)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack((c * x + s * y, c * y - s * x, vectors[..., 2]), axis=-1)


def _residuals(common: FloatArray, odometry: FloatArray, state: FloatArray) -> FloatArray:
    """Return seen minus expected places in the odometry frame, shape (n, 3)."""
    return odometry - (common - state[:3]) @ _turn(state[3])


def _distances(
    common: FloatArray, odometry: FloatArray, weights: FloatArray, state: FloatArray
) -> FloatArray:
    """Return squared Mahalanobis distances, shape (n,)."""
    e = _residuals(common, odometry, state)
    result: FloatArray = np.einsum("ni,nij,nj->n", e, weights, e)
    return result


def _agreeing(
    common: FloatArray, odometry: FloatArray, weights: FloatArray, state: FloatArray
) -> BoolArray:
    limit = float(chdtri(3, 1.0 - AGREE_PROBABILITY))
    return _distances(common, odometry, weights, state) <= limit


def _refined(
    common: FloatArray, odometry: FloatArray, weights: FloatArray, state: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the weighted least-squares state and its covariance."""
    for _ in range(_ROUNDS):
        e, jacobian = linearized(common, odometry, state)
        information = np.einsum("nki,nkl,nlj->ij", jacobian, weights, jacobian)
        gradient = np.einsum("nki,nkl,nl->i", jacobian, weights, e)
        step = np.linalg.solve(information, -gradient)
        state = state + step
        if np.abs(step).max() < 1e-10:
            break
    return state, np.linalg.inv(information)


def linearized(
    common: FloatArray, odometry: FloatArray, state: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how far sightings are from where they should be, and the derivative of that.

    Args:
        common: Places of the tags, shape (n, 3).
        odometry: Where they were seen in the odometry frame, shape (n, 3).
        state: (east, north, up, psi), shape (4,).

    Returns:
        Residuals (n, 3), seen minus expected, and their derivatives by the state (n, 3, 4).
    """
    jacobian = np.empty((len(common), 3, 4))
    jacobian[:, :, :3] = _turn(state[3]).T
    away = common - state[:3]
    # d/dpsi of -R_z(psi)' a
    c, s = np.cos(state[3]), np.sin(state[3])
    jacobian[:, 0, 3] = s * away[:, 0] - c * away[:, 1]
    jacobian[:, 1, 3] = c * away[:, 0] + s * away[:, 1]
    jacobian[:, 2, 3] = 0.0
    return _residuals(common, odometry, state), jacobian


def _turn(psi: float) -> FloatArray:
    c, s = np.cos(psi), np.sin(psi)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
