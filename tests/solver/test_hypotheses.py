"""The posterior of one zone, against plain Monte Carlo from the law as it is written."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from solver import hypotheses
from solver.arrays import FloatArray
from solver.encounters import Evidence, Marks
from solver.hypotheses import Background, Cloud, Known, Law, Proposal

LAW = Law(period_s=0.5, step_s=0.1, recover_density=0.03, per_m2=0.01, fault_rate=1e-3)
HIT = (1.0, -0.5)
DRAWS = 200_000


def marks(*told: tuple[float, float, float]) -> Marks:
    """Return marks at (x, y) of some weight."""
    values = np.array(told, dtype=np.float64).reshape(-1, 3)
    return Marks(values[:, :2], values[:, 2])


@pytest.fixture
def many(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Draw so many hypotheses that chance plays no part: what is left is the law."""
    monkeypatch.setattr(hypotheses, "HYPOTHESES", 2**17)
    hypotheses._base.cache_clear()
    yield
    hypotheses._base.cache_clear()


NONE = marks()
ONE_HIT = Evidence(NONE, marks((*HIT, 1.0)), NONE, NONE)


def others(hits: float = 0.0, inside: float = 0.0, evidence: Evidence = ONE_HIT) -> Background:
    """Return a background that is the same at all marks."""
    return Background(
        np.full(len(evidence.hits.weights), hits), np.full(len(evidence.inside.weights), inside)
    )


def extents(theta: FloatArray) -> FloatArray:
    """S (K, 2, 2) by the eigenvalues +-t of [[a, b], [b, -a]], written apart."""
    turn = np.hypot(theta[:, 3], theta[:, 4])
    unit = np.stack([theta[:, 3], theta[:, 4]], axis=1) / np.maximum(turn, 1e-12)[:, None]
    axis = np.stack([unit, np.stack([unit[:, 1], -unit[:, 0]], axis=1)], axis=1)
    grown, shrunk = np.exp(turn)[:, None, None], np.exp(-turn)[:, None, None]
    up, down = 0.5 * (np.eye(2) + axis), 0.5 * (np.eye(2) - axis)
    return np.asarray(np.exp(2.0 * theta[:, 2])[:, None, None] * (grown * up + shrunk * down))


def density(theta: FloatArray, points: FloatArray) -> FloatArray:
    """Densities (K, n)."""
    S = extents(theta)
    offset = points[None] - theta[:, None, :2]
    distance = np.einsum("kni,kij,knj->kn", offset, np.linalg.inv(S), offset)
    scale = np.exp(theta[:, 5]) / (2.0 * np.pi * np.sqrt(np.linalg.det(S)))
    return np.asarray(scale[:, None] * np.exp(-0.5 * distance))


def likelihood(theta: FloatArray, evidence: Evidence, background: Background) -> FloatArray:
    """What hits and inside marks say for the zone, and what the other ones say against it."""
    chance = LAW.step_s / LAW.period_s
    other = chance * background.hits + LAW.fault_rate * LAW.step_s
    caused = (1.0 + chance * density(theta, evidence.hits.points) / other) ** evidence.hits.weights
    held = kept(density(theta, evidence.inside.points))
    alone = np.maximum(kept(background.inside), 0.02)
    caused = np.hstack(
        [caused, ((1 - (1 - held) * (1 - alone)) / alone) ** evidence.inside.weights]
    )
    clear = 1.0 - chance * density(theta, evidence.clear.points)
    spoken = clear ** (evidence.clear.weights / LAW.step_s)
    ended = np.maximum(1.0 - kept(density(theta, evidence.outside.points)), 0.02)
    spoken = np.hstack([spoken, ended**evidence.outside.weights])
    return np.stack([caused.prod(axis=1), spoken.prod(axis=1)])


def kept(values: FloatArray) -> FloatArray:
    """How likely densities are to keep a failure going."""
    power = (LAW.recover_density / np.maximum(values, 1e-60)) ** (1.0 / 0.4)
    return np.asarray(1.0 / (1.0 + power))


def sampled(evidence: Evidence, background: Background) -> tuple[FloatArray, FloatArray]:
    """Return hypotheses drawn around the hit, and the posterior's weights of them, summed up to
    the odds times their number."""
    dice = np.random.default_rng(0)
    reach = 2.0
    centres = np.asarray(HIT) + reach * dice.standard_normal((DRAWS, 2))
    spreads = [LAW.deviation_spread, LAW.elongation, LAW.elongation, LAW.strength_spread]
    shapes = dice.standard_normal((DRAWS, 4)) * spreads
    shapes[:, 0] += np.log(LAW.deviation_m)
    theta = np.hstack([centres, shapes])
    caused, spoken = likelihood(theta, evidence, background)
    drawn = multivariate_normal(HIT, reach**2 * np.eye(2)).pdf(centres)
    return theta, LAW.per_m2 * (caused - 1.0) * spoken / drawn


def check(cloud: Cloud, theta: FloatArray, weights: FloatArray, odds: float) -> None:
    """Hold a cloud to the moments of weighted hypotheses."""
    share = weights / weights.sum()
    centre = share @ theta[:, :2]
    offset = theta[:, :2] - centre
    spread = (offset * share[:, None]).T @ offset
    deviation = float(np.sqrt(np.trace(spread)))
    np.testing.assert_allclose(cloud.centre, centre, atol=0.02 * deviation)
    np.testing.assert_allclose(cloud.centre_covariance, spread, atol=0.04 * deviation**2)
    extent = np.einsum("k,kij->ij", share, extents(theta))
    np.testing.assert_allclose(cloud.extent, extent, atol=0.01 * np.trace(extent))
    strengths = np.exp(theta[:, 5])
    strength = float(share @ strengths)
    assert cloud.strength == pytest.approx(strength, rel=0.04)
    deviation = float(np.sqrt(share @ (strengths - strength) ** 2))
    assert cloud.strength_deviation == pytest.approx(deviation, rel=0.15)
    assert cloud.log_odds == pytest.approx(np.log(odds), abs=0.03)
    np.testing.assert_array_equal(cloud.predictive, cloud.extent + cloud.centre_covariance)


def test_densities_and_extents_are_those_of_the_matrix_exponential() -> None:
    dice = np.random.default_rng(1)
    theta = dice.normal(size=(20, 6))
    theta[0, 3:5] = 0.0
    points = dice.normal(size=(5, 2))
    for row in range(20):
        x, y, size, a, b, strength = theta[row]
        S = np.exp(2.0 * size) * expm(np.array([[a, b], [b, -a]]))
        np.testing.assert_allclose(hypotheses.extents(theta)[row], S, rtol=1e-9)
        expected = strength + multivariate_normal((x, y), S).logpdf(points)
        np.testing.assert_allclose(hypotheses.densities(theta, points)[row], expected, rtol=1e-8)


def test_a_failure_goes_on_where_the_density_is_above_that_of_recovery() -> None:
    edge = np.log(LAW.recover_density)
    asked = edge + np.array([0.0, 0.4, -0.8, 1e3, -1e3, -np.inf])
    expected = 1.0 / (1.0 + np.exp([0.0, -1.0, 2.0, -60.0, 60.0, 60.0]))
    np.testing.assert_allclose(hypotheses.inside(asked, LAW), expected)


def test_hypotheses_after_a_hit_are_as_wide_as_zones_are() -> None:
    law = replace(LAW, deviation_m=0.5, deviation_spread=0.3, elongation=0.1, strength_spread=0.4)
    start = hypotheses.around(np.asarray(HIT), law)
    np.testing.assert_allclose(start.mean, [*HIT, np.log(0.5), 0.0, 0.0, 0.0])
    reach = 2.0 * 0.25 * np.exp(2.0 * 0.09)
    np.testing.assert_allclose(start.covariance, np.diag([reach, reach, 0.09, 0.01, 0.01, 0.16]))


@pytest.mark.parametrize("elsewhere", [0.0, 0.1])
@pytest.mark.usefixtures("many")
def test_after_one_hit_zones_are_as_likely_as_the_law_says(elsewhere: float) -> None:
    """The integral over all places and shapes can be done by hand."""
    background = others(hits=elsewhere)
    cloud = hypotheses.fitted(LAW, ONE_HIT, background, hypotheses.around(np.asarray(HIT), LAW), 3)
    other = 0.2 * elsewhere + 1e-4
    odds = LAW.per_m2 * 0.2 * np.exp(0.5 * LAW.strength_spread**2) / other
    assert cloud.log_odds == pytest.approx(np.log(odds), abs=0.02)
    np.testing.assert_allclose(cloud.centre, HIT, atol=0.05)
    assert cloud.converged
    check(cloud, *sampled(ONE_HIT, background), odds=odds)


RICH = Evidence(
    clear=marks((HIT[0] + 0.8, HIT[1], 3.0), (HIT[0], HIT[1] + 1.0, 1.0)),
    hits=marks((*HIT, 2.0), (HIT[0] - 0.3, HIT[1], 1.0)),
    inside=marks((HIT[0] - 0.9, HIT[1] + 0.1, 1.0)),
    outside=marks((HIT[0] + 1.4, HIT[1] - 0.2, 1.0)),
)


@pytest.mark.parametrize(("hits", "inside"), [(0.0, 0.0), (0.05, 0.01)])
@pytest.mark.usefixtures("many")
def test_all_kinds_of_evidence_count_as_the_law_says(hits: float, inside: float) -> None:
    background = others(hits, inside, RICH)
    theta, weights = sampled(RICH, background)
    start = hypotheses.around(np.asarray(HIT), LAW)
    cloud = hypotheses.fitted(LAW, RICH, background, start, 4)
    check(cloud, theta, weights, float(weights.mean()))


@pytest.mark.parametrize("missing", ["clear", "inside", "outside"])
@pytest.mark.usefixtures("many")
def test_each_kind_of_evidence_counts_by_itself(missing: str) -> None:
    evidence = replace(ONE_HIT, **{missing: getattr(RICH, missing)})
    background = others(evidence=evidence)
    theta, weights = sampled(evidence, background)
    start = hypotheses.around(np.asarray(HIT), LAW)
    cloud = hypotheses.fitted(LAW, evidence, background, start, 4)
    check(cloud, theta, weights, float(weights.mean()))


def known(log_odds: float) -> Known:
    factor = np.random.default_rng(2).normal(size=(6, 6))
    scale = np.diag([0.3, 0.2, 0.1, 0.1, 0.1, 0.1])
    covariance = scale @ (0.2 * factor @ factor.T + np.eye(6)) @ scale
    return Known(Proposal(np.array([*HIT, -0.5, 0.1, -0.1, 0.05]), covariance), log_odds)


@pytest.mark.usefixtures("many")
def test_what_is_remembered_is_what_was_known() -> None:
    before = known(1.3)
    cloud = hypotheses.remembered(before)
    theta = np.random.default_rng(3).multivariate_normal(
        before.proposal.mean, before.proposal.covariance, DRAWS
    )
    check(cloud, theta, np.ones(DRAWS), odds=float(np.exp(1.3)))
    scale = np.sqrt(np.diag(before.proposal.covariance))
    np.testing.assert_allclose(cloud.proposal.mean, before.proposal.mean, atol=0.02 * scale.max())
    np.testing.assert_allclose(
        cloud.proposal.covariance / np.outer(scale, scale),
        before.proposal.covariance / np.outer(scale, scale),
        atol=0.05,
    )


@pytest.mark.usefixtures("many")
def test_a_zone_known_before_may_have_caused_nothing() -> None:
    before = known(-0.7)
    background = others(0.02, 0.01, RICH)
    theta = np.random.default_rng(3).multivariate_normal(
        before.proposal.mean, before.proposal.covariance, DRAWS
    )
    caused, spoken = likelihood(theta, RICH, background)
    weights = np.exp(-0.7) * caused * spoken
    cloud = hypotheses.fitted(LAW, RICH, background, before.proposal, 3, before)
    check(cloud, theta, weights, float(weights.mean()))


def test_few_hypotheses_that_count_are_a_cloud_to_be_looked_at_again() -> None:
    far = Proposal(np.array([8.0, 8.0, 0.0, 0.0, 0.0, 0.0]), 0.01 * np.eye(6))
    cloud = hypotheses.fitted(LAW, ONE_HIT, others(), far, 1)
    assert not cloud.converged
    found = cloud
    for _ in range(20):
        found = hypotheses.fitted(LAW, ONE_HIT, others(), found.proposal, 2)
    assert found.converged
    np.testing.assert_allclose(found.centre, HIT, atol=0.1)


def test_evidence_beyond_all_doubt_stays_a_number() -> None:
    sure = Evidence(NONE, marks((*HIT, 1e4)), NONE, NONE)
    cloud = hypotheses.fitted(
        LAW, sure, others(evidence=sure), hypotheses.around(np.asarray(HIT), LAW), 4
    )
    assert np.isfinite(cloud.log_odds)
    assert cloud.log_odds > 1e4
