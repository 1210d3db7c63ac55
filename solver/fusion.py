"""Fusing a returning robot's tracks into the team's without counting anything twice.

While a robot was cut off, its filter and the team's kept common information whose extent
nobody knows. Covariance intersection (Julier and Uhlmann, 1997),
`P^-1 = w A^-1 + (1 - w) B^-1`, is consistent whatever the correlation.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from solver import matrices
from solver.arrays import FloatArray
from solver.beliefs import Beliefs, bounded, is_covariance
from solver.observations import OnboardTrack

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_SEARCH_STEPS = 24
MOST_INFORMATION = 1e18
"""Of an entry, 1/m^2 and the like: no filter knows so much, and sums of more overflow."""

_LEAST_SHARE = 1e-3
"""Neither side is ignored wholly: one that holds no velocity would leave none."""


def fuse(beliefs: Beliefs, tracks: tuple[OnboardTrack, ...]) -> Beliefs:
    """Return the beliefs after covariance intersection with on-board tracks.

    The share w of each target is the one that makes the trace of its position covariance
    least. A target that the team does not know is taken over as it is. Ignored are tracks of
    unknown ids, further tracks of a target, and those without a finite mean and a positive
    definite covariance. A track of the other motion model counts with its position alone.
    """
    index = {target_id: row for row, target_id in enumerate(beliefs.ids)}
    means, P, known = beliefs.means.copy(), beliefs.covariances.copy(), beliefs.known.copy()
    d = means.shape[1]
    chosen: dict[int, tuple[OnboardTrack, FloatArray]] = {}
    for track in tracks:
        row = index.get(track.target_id)
        if row is not None and row not in chosen:
            information = _information(track, d)
            if information is not None:
                chosen[row] = track, information
    if not chosen:
        return beliefs
    rows = np.fromiter(chosen, dtype=np.int64)
    other_means = np.zeros((len(rows), d))
    other_information = np.zeros((len(rows), d, d))
    for k, (row, (track, information)) in enumerate(chosen.items()):
        size = len(information)
        other_means[k, :size] = track.mean[:size]
        other_information[k, :size, :size] = information
        if not known[row]:
            means[row] = other_means[k]
            P[row, :size, :size] = np.array(track.covariance)[:size, :size]
    both = known[rows]
    if both.any():
        merged = rows[both]
        means[merged], P[merged] = _intersected(
            means[merged], P[merged], other_means[both], other_information[both]
        )
    unseen = beliefs.unseen_s.copy()
    unseen[rows[~both]] = 0.0
    known[rows] = True
    return replace(
        beliefs,
        means=means,
        covariances=bounded(P),
        known=known,
        started=beliefs.started | known,
        unseen_s=unseen,
    )


def _information(track: OnboardTrack, dimension: int) -> FloatArray | None:
    """Return the information of a track in the filter's dimension, None for one of no use.

    Rounding can make a singular covariance look positive definite, and a robot can say one.
    """
    size = len(track.mean)
    if size not in (2, 4) or [len(row) for row in track.covariance] != [size] * size:
        return None
    covariance = np.array(track.covariance)
    if not (np.isfinite(track.mean).all() and is_covariance(covariance)):
        return None
    size = min(dimension, size)
    try:
        information = np.asarray(np.linalg.inv(covariance[:size, :size]), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    # Not a number is no less either.
    return information if np.abs(information).max() <= MOST_INFORMATION else None


def _intersected(
    means: FloatArray, P: FloatArray, other_means: FloatArray, B: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return fused means (n, d) and covariances (n, d, d); B is the other side's information."""
    A = np.linalg.inv(P)

    def spread(share: FloatArray) -> FloatArray:
        fused = np.linalg.inv(share[:, None, None] * A + (1.0 - share)[:, None, None] * B)
        return np.asarray(fused[:, 0, 0] + fused[:, 1, 1])

    share = _least(spread, len(P))[:, None, None]
    fused = np.asarray(np.linalg.inv(share * A + (1.0 - share) * B), dtype=np.float64)
    pull = share * (A @ means[:, :, None]) + (1.0 - share) * (B @ other_means[:, :, None])
    return (fused @ pull)[:, :, 0], matrices.symmetric(fused)


def _least(spread: Callable[[FloatArray], FloatArray], count: int) -> FloatArray:
    """Return the minimisers of `count` convex functions of a share, by golden section."""
    low, high = np.full(count, _LEAST_SHARE), np.full(count, 1.0 - _LEAST_SHARE)
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = spread(left), spread(right)
    for _ in range(_SEARCH_STEPS):
        falls = at_right < at_left
        low, high = np.where(falls, left, low), np.where(falls, high, right)
        new = np.where(falls, low + _GOLDEN * (high - low), high - _GOLDEN * (high - low))
        at_new = spread(new)
        left, right = np.where(falls, right, new), np.where(falls, new, left)
        at_left, at_right = np.where(falls, at_right, at_new), np.where(falls, at_new, at_left)
    ends = np.stack((low, 0.5 * (low + high), high))
    best = np.argmin(np.stack([spread(end) for end in ends]), axis=0)
    return np.asarray(np.take_along_axis(ends, best[None], axis=0)[0])
