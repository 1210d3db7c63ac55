"""What a hazard map is told and what it tells: plain values. Frame ENU, metres, seconds."""

from dataclasses import dataclass

from solver.arrays import BoolArray, FloatArray, IntArray
from solver.zones import Matrix2, Point


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """What happened to n robots of which the places are known, in one step."""

    positions: FloatArray
    """(n, 2) metres."""

    seconds: FloatArray
    """(n,) time that the step stands for."""

    hits: IntArray
    """(n,) times each was hit."""

    failing: BoolArray
    """(n,) whose failure went on."""

    recovered: BoolArray
    """(n,) whose failure ended."""


@dataclass(frozen=True, slots=True)
class HazardEstimate:
    """One zone as far as it is known."""

    key: int
    """Stays the same for as long as the zone is believed in."""

    mean: Point
    """Of the centre."""

    centre_covariance: Matrix2
    """How uncertain the centre is, m^2."""

    extent: Matrix2
    """Mean of the covariance S of its density, m^2."""

    strength: float
    """Factor on the density that the law of attacks would have, 1 as told."""

    strength_deviation: float
    confidence: float
    """Probability that there is such a zone."""

    since_s: float
    """When it was first believed in."""

    @property
    def covariance(self) -> Matrix2:
        """Covariance of the density of attacks to be expected: extent and doubt together."""
        (a, b), (_, d) = self.extent
        (p, q), (_, s) = self.centre_covariance
        return ((a + p, b + q), (b + q, d + s))


@dataclass(frozen=True, slots=True)
class KeptHazard:
    """One zone in plain numbers, for another map."""

    key: int
    mean: tuple[float, ...]
    """(6,) of the hypotheses (`solver.hypotheses`)."""

    covariance: tuple[tuple[float, ...], ...]
    log_odds: float
    since_s: float
