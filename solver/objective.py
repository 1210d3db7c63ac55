"""The reduced objective: what every engine minimises, in numpy.

With every slack at its optimum `max(0, -g)` the soft constraints become squared hinges, and
the problem is smooth and box constrained in the controls alone (paper, eq. 3, reduced form).
Norms are smoothed so that no kink is left; the floor on the distance to a target is not a
smoothing but part of the sensor's model. `cost` and `gradient` are the smoothed objective,
`exact_cost` the one without smoothing, for judging engines.
"""

from dataclasses import astuple, dataclass, replace
from typing import NamedTuple

import numpy as np

from solver import matrices
from solver.arrays import FloatArray, IntArray
from solver.bounds import pulled_back, rollout
from solver.pairs import near_pairs
from solver.problem import Dynamics, Problem, ZoneTable
from solver.sensing import TARGET_FLOOR_M, gains

__all__ = [
    "MATE_SMOOTHING_M",
    "PRIOR_GREATEST",
    "PRIOR_LEAST",
    "TARGET_FLOOR_M",
    "ZONE_SMOOTHING_M",
    "Terms",
    "cost",
    "exact_cost",
    "exact_terms",
    "gradient",
    "rollout",
    "terms",
]

ZONE_SMOOTHING_M = 0.03
"""e: rounds off the norm at a zone's centre and between coincident robots."""

MATE_SMOOTHING_M = 0.05
"""tau: temperature of the soft maximum over team mates; a hard one stalls at ties."""

PRIOR_LEAST = 1e-6
PRIOR_GREATEST = 1e4
"""Eigenvalues of the priors, m^2: an indefinite one makes the cost unbounded."""


class _Smoothing(NamedTuple):
    zone_m: float
    mate_m: float


_SMOOTH = _Smoothing(ZONE_SMOOTHING_M, MATE_SMOOTHING_M)
_EXACT = _Smoothing(1e-9, 0.0)
"""The exact norm has no derivative at 0; at 1e-9 m it is exact to rounding and defined."""


@dataclass(frozen=True, slots=True)
class Terms:
    """The weighted parts of the objective; their sum is the cost."""

    tracking: float
    control: float
    sensing: float
    communication: float
    separation: float
    field: float

    @property
    def total(self) -> float:
        """Return the cost."""
        return float(sum(astuple(self)))


def terms(problem: Problem, controls: FloatArray) -> Terms:
    """Return the parts of the smoothed objective at controls (M, H, 2)."""
    return _evaluated(problem, controls, _SMOOTH)[0]


def exact_terms(problem: Problem, controls: FloatArray) -> Terms:
    """Return the parts of the objective without any smoothing."""
    return _evaluated(problem, controls, _EXACT)[0]


def cost(problem: Problem, controls: FloatArray) -> float:
    """Return the smoothed objective at controls (M, H, 2)."""
    return terms(problem, controls).total


def exact_cost(problem: Problem, controls: FloatArray) -> float:
    """Return the objective without any smoothing."""
    return exact_terms(problem, controls).total


def gradient(problem: Problem, controls: FloatArray) -> FloatArray:
    """Return the derivative of the smoothed objective by the controls, (M, H, 2)."""
    _, by_position, by_velocity = _evaluated(problem, controls, _SMOOTH)
    direct = 2.0 * problem.weights.control * controls
    return direct + pulled_back(problem, by_position, by_velocity)


def _evaluated(
    problem: Problem, controls: FloatArray, smoothing: _Smoothing
) -> tuple[Terms, FloatArray, FloatArray | None]:
    """Return the terms and the derivatives of their sum by positions and velocities."""
    weights = problem.weights
    positions, velocities = rollout(problem, controls)
    by_position = np.zeros_like(positions)
    result = Terms(
        tracking=_tracking(problem, positions, by_position),
        control=weights.control * float((controls * controls).sum()),
        sensing=_sensing(problem, positions, by_position, smoothing),
        communication=_communication(problem, positions, by_position, smoothing),
        separation=_separation(problem, positions, by_position, smoothing),
        field=_outside(problem, positions, by_position),
    )
    by_velocity = None
    if problem.dynamics is Dynamics.DOUBLE_INTEGRATOR:
        excess, by_velocity = _speeding(problem, velocities)
        result = replace(result, field=result.field + excess)
    return result, by_position, by_velocity


def _tracking(problem: Problem, positions: FloatArray, by_position: FloatArray) -> float:
    """Return w1 sum tr P_j(k); P(k) = (P^-^-1 + sum_i I_ij)^-1, P^-(k+1) = P(k) + growth."""
    weight, count = problem.weights.tracking, len(problem.target_priors)
    robots, targets = np.nonzero(problem.sees)
    posterior = prior = matrices.clamped(problem.target_priors, PRIOR_LEAST, PRIOR_GREATEST)
    steps = []
    total = 0.0
    for k in range(problem.horizon):
        if k:
            prior = posterior + problem.target_growth[k]
        p = positions[robots, k] - problem.target_means[k, targets]
        x, y = p[:, 0], p[:, 1]
        squared = x * x + y * y
        along, across = gains(problem.sensor, squared)
        precision = matrices.inverse(prior)
        summed = precision.copy()
        summed[:, 0, 0] += np.bincount(targets, along * x * x + across * y * y, count)
        summed[:, 1, 1] += np.bincount(targets, along * y * y + across * x * x, count)
        mixed = np.bincount(targets, (along - across) * x * y, count)
        summed[:, 0, 1] += mixed
        summed[:, 1, 0] += mixed
        posterior = matrices.inverse(summed)
        total += float((posterior[:, 0, 0] + posterior[:, 1, 1]).sum())
        steps.append((p, along, across, precision, posterior))
    onward = np.zeros((count, 2, 2))
    for k in range(problem.horizon - 1, -1, -1):
        p, along, across, precision, posterior = steps[k]
        sensitivity = weight * np.eye(2) + onward
        M = posterior @ sensitivity @ posterior
        _add_at(by_position, robots, k, -_information_slope(problem, p, along, across, M[targets]))
        onward = precision @ M @ precision
    return weight * total


def _information_slope(
    problem: Problem, p: FloatArray, along: FloatArray, across: FloatArray, M: FloatArray
) -> FloatArray:
    """Return d <M, I(p)> / dp, shape (E, 2), for I = a p p' + b (Jp)(Jp)'."""
    sensor = problem.sensor
    floored = (p * p).sum(axis=1) + TARGET_FLOOR_M**2
    rho = np.sqrt(floored)
    turned = np.stack((-p[:, 1], p[:, 0]), axis=1)
    Mp = (M @ p[:, :, None])[:, :, 0]
    Mt = (M @ turned[:, :, None])[:, :, 0]
    radial = along * (-sensor.range_shape / rho - 2.0 / floored) * (p * Mp).sum(axis=1)
    radial += across * (-sensor.bearing_shape / rho - 4.0 / floored) * (turned * Mt).sum(axis=1)
    turned_back = np.stack((Mt[:, 1], -Mt[:, 0]), axis=1)
    return np.asarray(
        2.0 * (along[:, None] * Mp + across[:, None] * turned_back) + radial[:, None] * p
    )


def _add_at(by_position: FloatArray, robots: IntArray, k: int, values: FloatArray) -> None:
    count = len(by_position)
    for axis in range(2):
        by_position[:, k, axis] += np.bincount(robots, values[:, axis], count)


def _sensing(
    problem: Problem, positions: FloatArray, by_position: FloatArray, smoothing: _Smoothing
) -> float:
    """Return the squared hinges of the sensing zones that robots know."""
    table = problem.sensing
    robots, zones = np.nonzero(table.known)
    if not len(robots):
        return 0.0
    margins = table.margins[zones, None]
    short, slope = _shortfall(table, zones, positions[robots], margins, smoothing.zone_m)
    weight = problem.weights.sensing * table.severities[zones, None]
    by_short = 2.0 * weight * short
    np.add.at(by_position, robots, -by_short[:, :, None] * slope)
    return float((weight * short * short).sum())


def _communication(
    problem: Problem, positions: FloatArray, by_position: FloatArray, smoothing: _Smoothing
) -> float:
    """Return the squared hinges of communication zones; their margin grows with the spread."""
    table = problem.communication
    robots, zones = np.nonzero(table.known)
    if not len(robots):
        return 0.0
    own = np.unique(robots)
    row = np.searchsorted(own, robots)
    spread, by_own, by_mate = _spread(positions, own, smoothing)
    factors = table.margins[zones, None]
    margins = factors * spread[row]
    short, slope = _shortfall(table, zones, positions[robots], margins, smoothing.zone_m)
    weight = problem.weights.communication * table.severities[zones, None]
    by_short = 2.0 * weight * short
    np.add.at(by_position, robots, -by_short[:, :, None] * slope)
    by_spread = np.zeros(spread.shape)
    np.add.at(by_spread, row, by_short * factors)
    by_position[own] += by_spread[:, :, None] * by_own
    by_position += np.einsum("ik,ilkd->lkd", by_spread, by_mate)
    return float((weight * short * short).sum())


def _shortfall(
    table: ZoneTable, zones: IntArray, positions: FloatArray, margins: FloatArray, e: float
) -> tuple[FloatArray, FloatArray]:
    """Return max(0, -g) and dg/dx of pairs of robot and zone over the horizon.

    g = sqrt(a'a + e^2) - e - q sqrt((a'S a + e^2 tr S / 2) / (a'a + e^2)) - margin, a = mu - x.

    Args:
        table: The zones.
        zones: (E,) zone of each pair.
        positions: (E, H, 2) positions of the pair's robot.
        margins: (E, H) or (E, 1), m.
        e: Smoothing length, m.

    Returns:
        Shortfalls (E, H) and slopes (E, H, 2).
    """
    a = table.centres[zones, None] - positions
    S = table.covariances[zones, None]
    q = table.quantiles[zones, None]
    Sa = (S @ a[..., None])[..., 0]
    squared = (a * a).sum(axis=-1) + e * e
    length = np.sqrt(squared)
    spread = (a * Sa).sum(axis=-1) + 0.5 * e * e * (S[..., 0, 0] + S[..., 1, 1])
    deviation = np.sqrt(spread / squared)
    g = length - e - q * deviation - margins
    along_a = 1.0 / length + q * spread / (squared * squared * deviation)
    slope = (q / (squared * deviation))[..., None] * Sa - along_a[..., None] * a
    return np.maximum(0.0, -g), slope


def _spread(
    positions: FloatArray, own: IntArray, smoothing: _Smoothing
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return how far each robot of `own` is from the farthest team mate, over the horizon.

    Returns:
        D (R, H), dD_i/dx_i (R, H, 2), dD_i/dx_l (R, M, H, 2).
    """
    e, tau = smoothing
    count, horizon = positions.shape[:2]
    if count < 2:
        zero = np.zeros((len(own), horizon))
        by_mate = np.zeros((len(own), count, horizon, 2))
        return zero, by_mate[:, 0], by_mate
    offset = positions[own, None] - positions[None]
    length = np.sqrt((offset * offset).sum(axis=-1) + e * e)
    distance = length - e
    distance[np.arange(len(own)), own] = -np.inf
    farthest = distance.max(axis=1)
    if tau > 0.0:
        share = np.exp((distance - farthest[:, None]) / tau)
        total = share.sum(axis=1)
        farthest = farthest + tau * np.log(total)
        share /= total[:, None]
    else:
        share = (distance == farthest[:, None]).astype(np.float64)
        share /= share.sum(axis=1, keepdims=True)
    pull = (share / length)[..., None] * offset
    return farthest, pull.sum(axis=1), -pull


def _separation(
    problem: Problem, positions: FloatArray, by_position: FloatArray, smoothing: _Smoothing
) -> float:
    """Return the squared hinges of robots nearer than min_dist to mates and obstacles."""
    weight, total = problem.separation_weight, 0.0
    first, second = _ever_near(positions, problem.min_dist_m + smoothing.zone_m)
    if len(first):
        offset = positions[first] - positions[second]
        value, slope = _crowding(offset, problem.min_dist_m, smoothing.zone_m)
        total += value
        np.add.at(by_position, first, weight * slope)
        np.add.at(by_position, second, -weight * slope)
    if len(problem.obstacles):
        offset = positions[:, None] - problem.obstacles[None, :, None]
        value, slope = _crowding(offset, problem.min_dist_m, smoothing.zone_m)
        total += value
        by_position += weight * slope.sum(axis=1)
    return weight * total


def _ever_near(positions: FloatArray, reach: float) -> tuple[IntArray, IntArray]:
    """Return index arrays of all pairs that may be nearer than `reach` at any step."""
    found = [near_pairs(positions[:, k], reach) for k in range(positions.shape[1])]
    # Small teams get all their pairs, the same two arrays at every step.
    if len(found) == 1 or found[0][0] is found[1][0]:
        return found[0]
    pairs = np.unique(np.concatenate([np.stack(each, axis=1) for each in found]), axis=0)
    return pairs[:, 0], pairs[:, 1]


def _crowding(offset: FloatArray, reach: float, e: float) -> tuple[float, FloatArray]:
    """Return sum max(0, reach - d)^2 and its derivative by the offsets (..., 2)."""
    length = np.sqrt((offset * offset).sum(axis=-1) + e * e)
    short = np.maximum(0.0, reach - (length - e))
    return float((short * short).sum()), (-2.0 * short / length)[..., None] * offset


def _outside(problem: Problem, positions: FloatArray, by_position: FloatArray) -> float:
    """Return the squared hinges of leaving the field after the first step."""
    later = positions[:, 1:]
    beyond = np.maximum(0.0, later - problem.field_upper)
    beyond -= np.maximum(0.0, problem.field_lower - later)
    by_position[:, 1:] += 2.0 * problem.field_weight * beyond
    return problem.field_weight * float((beyond * beyond).sum())


def _speeding(problem: Problem, velocities: FloatArray) -> tuple[float, FloatArray]:
    """Return the squared hinges of the speed limit after the first step, and their slope."""
    limit = problem.speed_limit[:, None, None]
    excess = velocities - np.clip(velocities, -limit, limit)
    excess[:, 0] = 0.0
    slope = 2.0 * problem.field_weight * excess
    return problem.field_weight * float((excess * excess).sum()), slope
