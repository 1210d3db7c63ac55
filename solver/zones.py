"""Danger zones: where attacks come from (paper, section III-B).

Frame ENU, metres. A zone is a Gaussian density over the plane; what robots fear of it is
its keep-out margin, which depends on its kind.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from solver.arrays import FloatArray

Point = tuple[float, float]
Matrix2 = tuple[Point, Point]


class ZoneKind(StrEnum):
    """What an attack from the zone takes away."""

    SENSING = "sensing"
    COMMUNICATION = "communication"


@dataclass(frozen=True, slots=True)
class Zone:
    """One danger zone, as somebody believes it to be."""

    id: str
    """Unique within a mission, for people and wire messages."""

    kind: ZoneKind

    mean: Point
    """Centre, metres."""

    covariance: Matrix2
    """Extent, square metres, symmetric positive definite."""

    margin: float
    """Sensing: metres added to the keep-out radius (r of the paper's G(x, S)).
    Communication: factor on the spread of the team (delta), dimensionless."""

    risk: float
    """Tolerated chance-constraint risk in (0, 0.5]: eps1, or 1 - eps2 for communication."""

    risk_single: float = 0.1
    """The risk a robot accepts that is cut off and plans alone (eps2_single)."""

    def quantile(self, severity: float = 1.0) -> float:
        """Return the factor on the directional deviation sqrt(n'Sn), dimensionless.

        It is sqrt(2) erfinv(1 - 2 risk), times the square root of the severity.
        """
        return _quantile(self.risk, severity)

    def quantile_single(self, severity: float = 1.0) -> float:
        """Return the same factor at the risk accepted by a robot that plans alone."""
        return _quantile(self.risk_single, severity)

    def density(self, points: FloatArray) -> FloatArray:
        """Return the Gaussian density at points of shape (..., 2), shape (...), 1/m^2."""
        covariance = np.asarray(self.covariance)
        offset = np.asarray(points) - np.asarray(self.mean)
        solved = np.einsum("ij,...j->...i", np.linalg.inv(covariance), offset)
        mahalanobis = np.einsum("...i,...i->...", offset, solved)
        scale = 2.0 * np.pi * np.sqrt(np.linalg.det(covariance))
        return np.asarray(np.exp(-0.5 * mahalanobis) / scale)


def _quantile(risk: float, severity: float) -> float:
    # Whoever only reads, draws or simulates zones never asks: importing SciPy takes longer than
    # the rest of the vocabulary. Planners have imported it with the objective.
    from scipy.special import erfinv

    return float(np.sqrt(2.0 * severity) * erfinv(1.0 - 2.0 * risk))
