"""What one danger zone may be, given the evidence: a weighted cloud of hypotheses.

A hypothesis is a centre, a Gaussian extent and a strength: theta = (x, y, l, a, b, g) with

    S = exp(2 l) expm([[a, b], [b, -a]]),   density(x) = exp(g) N(x; (x, y), S)

so that every theta is a zone and turning the axes changes nothing. The posterior is that of the
law of attacks (paper, section III-B): per step a hit with probability min(1, density dt / period),
and a failure that ends where no density reaches the recovery density. It is computed by adaptive
importance sampling (Cappe et al., "Population Monte Carlo", 2004) from a multivariate Student
distribution at fixed base points: no dice, and the same evidence gives the same cloud. The mean of
its weights is the evidence for there being a zone at all.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from solver.arrays import FloatArray, frozen
from solver.encounters import Evidence

DIMENSION = 6
HYPOTHESES = 512
TAIL = 5.0
"""Degrees of freedom of the distribution that is drawn from."""

INFLATION = 1.25
"""Of the covariance that is drawn with: what a few hundred hypotheses say of it is too small."""

WIDER = 2.0
"""How much wider the distribution is that one in four hypotheses is drawn from."""

RIM_SOFTNESS = 0.4
"""Of the recovery density, as a logarithm: places of robots and the law itself are not exact."""

DOUBT = 0.02
"""Chance that a failure went on, or ended, for a reason that is no zone's."""

_HIGHEST_CHANCE = 0.98
_LEAST_SHARE = 0.08
"""Effective share of the hypotheses that a proposal is fitted to."""


@dataclass(frozen=True, slots=True)
class Law:
    """How attacks come about, and what zones are like before anything is known of them."""

    period_s: float
    """Time in which a density of 1/m^2 hits once."""

    step_s: float
    """Time between throws of the dice."""

    recover_density: float
    """A failure ends where the density is below this, 1/m^2."""

    per_m2: float
    """Zones of this kind expected per square metre."""

    fault_rate: float
    """Failures per second that no zone has caused."""

    deviation_m: float = 0.7
    """Median standard deviation of a zone."""

    deviation_spread: float = 0.4
    """Standard deviation of its logarithm."""

    elongation: float = 0.2
    """Standard deviation of a and b."""

    strength_spread: float = 0.25
    """Standard deviation of g: the law is taken to hold as it is told, nearly."""


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """What everything but the zone in question does at the marks of its evidence."""

    hits: FloatArray
    """(n,) density of the other zones at each hit, 1/m^2."""

    inside: FloatArray
    """(n,) the same where failures went on."""


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """Where hypotheses are looked for: mean (6,) and covariance (6, 6)."""

    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """A zone that was believed in when evidence began: what takes the place of the prior."""

    proposal: Proposal
    log_odds: float


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """The posterior of one zone."""

    proposal: Proposal
    """What a next cloud is best drawn from."""

    centre: FloatArray
    """(2,) mean of the centre, m."""

    centre_covariance: FloatArray
    """(2, 2) how uncertain it is, m^2."""

    extent: FloatArray
    """(2, 2) mean of S, m^2."""

    strength: float
    """Mean of exp(g): factor on the density that the law would have."""

    strength_deviation: float
    log_odds: float
    """For the zone being there against nothing but the background."""

    converged: bool
    """Whether enough hypotheses count; if not, the next fit is a better one."""

    @property
    def predictive(self) -> FloatArray:
        """Covariance (2, 2) of the density of attacks as far as it is known."""
        return np.asarray(self.extent + self.centre_covariance)


def around(place: FloatArray, law: Law) -> Proposal:
    """Return where to look for a zone after a hit at a place (2,)."""
    mean = np.array([*place, np.log(law.deviation_m), 0.0, 0.0, 0.0])
    reach = 2.0 * law.deviation_m**2 * np.exp(2.0 * law.deviation_spread**2)
    return Proposal(mean, np.diag([reach, reach, *_shape_variances(law)]))


def fitted(
    law: Law,
    evidence: Evidence,
    background: Background,
    proposal: Proposal,
    rounds: int,
    known: Known | None = None,
) -> Cloud:
    """Return the posterior of a zone; every round looks where the last one has found most.

    Where nothing is left that a zone could have caused, the cloud is what was looked for, with
    log odds of minus infinity: no zone.

    Args:
        law: How attacks come about.
        evidence: The marks around the zone.
        background: What everything else does at them.
        proposal: Where to look first.
        rounds: How often to look, at least once.
        known: What takes the place of the prior.
    """
    for left in reversed(range(rounds)):
        theta, log_drawn = _drawn(proposal)
        log_weights = _log_posterior(law, evidence, background, theta, known) - log_drawn
        if log_weights.max() == -np.inf:
            return replace(remembered(Known(proposal, 0.0)), log_odds=-np.inf)
        if left:
            proposal = _moments(theta, _tempered(log_weights)[0])
    return _cloud(theta, log_weights)


def remembered(known: Known) -> Cloud:
    """Return the posterior of a zone that was known before, without any evidence."""
    theta, log_drawn = _drawn(known.proposal)
    return _cloud(theta, _log_known(known, theta) - log_drawn)


def densities(theta: FloatArray, points: FloatArray) -> FloatArray:
    """Return the logarithms (K, n) of the densities of hypotheses (K, 6) at points (n, 2)."""
    x, y, size, a, b, strength = theta.T[:, :, None]
    turn = np.hypot(a, b)
    along = np.cosh(turn)
    ratio = np.where(turn > 1e-9, np.sinh(turn) / np.maximum(turn, 1e-9), 1.0)
    scale = -0.5 * np.exp(-2.0 * size)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    p, q, r = scale * (along - ratio * a), scale * (along + ratio * a), -2.0 * scale * ratio * b
    inner = (p * dx + r * dy) * dx
    inner += q * dy * dy
    inner += strength - 2.0 * size - np.log(2.0 * np.pi)
    return np.asarray(inner)


def extents(theta: FloatArray) -> FloatArray:
    """Return S (K, 2, 2) of hypotheses (K, 6)."""
    size, a, b = theta[:, 2], theta[:, 3], theta[:, 4]
    turn = np.hypot(a, b)
    ratio = np.where(turn > 1e-9, np.sinh(turn) / np.maximum(turn, 1e-9), 1.0)
    along, across = np.cosh(turn), ratio * b
    rows = np.stack([along + ratio * a, across, across, along - ratio * a], axis=1)
    return np.asarray((np.exp(2.0 * size)[:, None] * rows).reshape(-1, 2, 2))


def inside(log_density: FloatArray, law: Law) -> FloatArray:
    """Return how likely a density is to keep a failure going, elementwise."""
    margin = (log_density - np.log(law.recover_density)) / RIM_SOFTNESS
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(margin, -60.0, 60.0))))


def _log_posterior(
    law: Law,
    evidence: Evidence,
    background: Background,
    theta: FloatArray,
    known: Known | None,
) -> FloatArray:
    """Return log prior + log likelihood against nothing but the background, (K,).

    Only zones that caused something count: the product over hits of 1 + zone / others is the sum
    over all sets of hits that may be the zone's, and the empty set is taken out of it. Zones that
    nobody has met yet are as likely as ever, and not what is asked for.
    """
    total = _log_prior(law, theta) if known is None else _log_known(known, theta)
    caused = np.zeros(len(theta))
    rate = law.step_s / law.period_s
    if len(evidence.clear.weights):
        chance = rate * np.exp(densities(theta, evidence.clear.points))
        steps = evidence.clear.weights / law.step_s
        total += np.log1p(-np.minimum(chance, _HIGHEST_CHANCE)) @ steps
    if len(evidence.hits.weights):
        chance = np.minimum(rate * np.exp(densities(theta, evidence.hits.points)), 1.0)
        other = rate * background.hits + law.fault_rate * law.step_s
        caused += np.log1p(chance / other) @ evidence.hits.weights
    if len(evidence.inside.weights):
        held = inside(densities(theta, evidence.inside.points), law)
        with np.errstate(divide="ignore"):
            other = np.maximum(inside(np.log(background.inside), law), DOUBT)
        caused += np.log((1.0 - (1.0 - held) * (1.0 - other)) / other) @ evidence.inside.weights
    if len(evidence.outside.weights):
        held = inside(densities(theta, evidence.outside.points), law)
        total += np.log(np.maximum(1.0 - held, DOUBT)) @ evidence.outside.weights
    if known is not None:
        return np.asarray(total + caused)
    with np.errstate(divide="ignore"):
        some = np.where(caused > 30.0, caused, np.log(np.expm1(np.clip(caused, 0.0, 30.0))))
    return np.asarray(total + some)


def _log_prior(law: Law, theta: FloatArray) -> FloatArray:
    """Return the prior's density: a Poisson field of centres, shapes that are normal."""
    variances = _shape_variances(law)
    offset = theta[:, 2:] - np.array([np.log(law.deviation_m), 0.0, 0.0, 0.0])
    scale = np.log(law.per_m2) - 0.5 * np.log(2.0 * np.pi * variances).sum()
    return np.asarray(scale - 0.5 * (offset**2 / variances).sum(axis=1))


def _log_known(known: Known, theta: FloatArray) -> FloatArray:
    """Return the density of a zone known before: normal, and as likely as it was."""
    root = np.linalg.cholesky(known.proposal.covariance)
    offset = np.linalg.solve(root, (theta - known.proposal.mean).T)
    scale = known.log_odds - 0.5 * DIMENSION * np.log(2.0 * np.pi) - np.log(np.diag(root)).sum()
    return np.asarray(scale - 0.5 * (offset**2).sum(axis=0))


def _shape_variances(law: Law) -> FloatArray:
    spreads = [law.deviation_spread, law.elongation, law.elongation, law.strength_spread]
    return np.asarray(spreads) ** 2


def _drawn(proposal: Proposal) -> tuple[FloatArray, FloatArray]:
    """Return hypotheses (K, 6) and the logarithm of the density that they are drawn with, (K,)."""
    root = np.linalg.cholesky(INFLATION * proposal.covariance)
    base, log_base = _base()
    return proposal.mean + base @ root.T, log_base - np.log(np.diag(root)).sum()


@cache
def _base() -> tuple[FloatArray, FloatArray]:
    """Return points (K, 6) of a mixture of two Student distributions, and their log densities.

    One in four is of the wider one, since a zone may lie on either side of the way on which a
    robot was hit. Fixed for ever, and in pairs around 0.
    """
    dice = np.random.Generator(np.random.Philox(key=6))
    half = dice.standard_normal((HYPOTHESES // 2, DIMENSION))
    stretch = np.sqrt(TAIL / dice.chisquare(TAIL, HYPOTHESES // 2))[:, None]
    stretch[::4] *= WIDER
    points = frozen(np.concatenate([half * stretch, -half * stretch]))
    distance = (points**2).sum(axis=1)
    # Gamma((v + 6) / 2) / Gamma(v / 2) is the product of the three steps in between.
    steps = np.log(np.arange(3) + TAIL / 2.0).sum()
    scale = steps - 0.5 * DIMENSION * np.log(np.pi * TAIL)
    power = -0.5 * (TAIL + DIMENSION)
    narrow = 0.75 * (1.0 + distance / TAIL) ** power
    wide = 0.25 * WIDER**-DIMENSION * (1.0 + distance / WIDER**2 / TAIL) ** power
    return points, frozen(scale + np.log(narrow + wide))


def _normal(log_weights: FloatArray) -> FloatArray:
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum())


def _tempered(log_weights: FloatArray) -> tuple[FloatArray, float]:
    """Return weights, flattened to a power for enough hypotheses to count, and the power."""
    power = 1.0
    weights = _normal(log_weights)
    while 1.0 / (weights**2).sum() < _LEAST_SHARE * len(weights) and power > 1e-3:
        power *= 0.6
        weights = _normal(power * log_weights)
    return weights, power


def _moments(theta: FloatArray, weights: FloatArray) -> Proposal:
    mean = weights @ theta
    offset = theta - mean
    covariance = (offset * weights[:, None]).T @ offset
    return Proposal(mean, covariance + 1e-5 * np.eye(DIMENSION))


def _cloud(theta: FloatArray, log_weights: FloatArray) -> Cloud:
    # Where few hypotheses count, what they say of the spread is not to be relied on.
    weights, power = _tempered(log_weights)
    centre = weights @ theta[:, :2]
    offset = theta[:, :2] - centre
    strengths = np.exp(theta[:, 5])
    strength = float(weights @ strengths)
    top = float(log_weights.max())
    return Cloud(
        proposal=_moments(theta, weights),
        centre=centre,
        centre_covariance=(offset * weights[:, None]).T @ offset,
        extent=np.einsum("k,kij->ij", weights, extents(theta)),
        strength=strength,
        strength_deviation=float(np.sqrt(weights @ np.square(strengths - strength))),
        converged=power == 1.0,
        log_odds=top + float(np.log(np.mean(np.exp(log_weights - top)))),
    )
