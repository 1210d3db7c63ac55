"""The hazard map: what it finds, how sure it is of it, and that it is right to be so sure."""

import numpy as np
import pytest

from solver import hypotheses
from solver.encounters import Evidence, Marks
from solver.hazards import MOST_ZONES, HazardMap
from solver.hypotheses import Background
from solver.inferences import Exposure, HazardEstimate
from tests.solver.attacked import LAW, STEP_S, TrueZone, Wandering, hazard_map, normal_density

NEAR, FAR = (-4.0, 1.0), (5.0, -2.0)


def zone(place: tuple[float, float], variance: float = 0.4) -> TrueZone:
    return np.asarray(place), variance * np.eye(2)


def told(
    hazards: HazardMap,
    places: list[tuple[float, float]],
    now_s: float,
    *,
    hits: int = 0,
    failing: bool = False,
    recovered: bool = False,
) -> None:
    """Tell a map of one step of robots at places that fare alike."""
    count = len(places)
    hazards.observe(
        Exposure(
            np.array(places, dtype=float).reshape(-1, 2),
            np.full(count, STEP_S),
            np.full(count, hits),
            np.full(count, failing),
            np.full(count, recovered),
        ),
        now_s,
    )


def settled(hazards: HazardMap) -> tuple[HazardEstimate, ...]:
    for _ in range(200):
        if not hazards.update():
            return hazards.estimates
    raise AssertionError("a map without news goes on thinking")


def error(estimate: HazardEstimate, truth: TrueZone) -> float:
    """Return the squared error of the centre in the map's own deviations."""
    offset = np.asarray(estimate.mean) - truth[0]
    return float(offset @ np.linalg.solve(np.asarray(estimate.centre_covariance), offset))


def test_two_zones_are_found_where_they_are() -> None:
    truths = [zone(NEAR), zone(FAR, 0.6)]
    team, hazards = Wandering(truths, seed=4, drawn_to=(NEAR, FAR)), hazard_map()
    team.walk(hazards, 150.0)
    assert team.hits > 6
    sure = [estimate for estimate in hazards.estimates if estimate.confidence > 0.9]
    assert len(sure) == 2
    for truth in truths:
        found = min(sure, key=lambda e: float(np.hypot(*(np.asarray(e.mean) - truth[0]))))
        assert np.hypot(*(np.asarray(found.mean) - truth[0])) < 0.8
        assert error(found, truth) < 12.0
        assert 0.3 < np.sqrt(np.linalg.det(found.extent) / np.linalg.det(truth[1])) < 3.0
        assert abs(found.strength - 1.0) < 3.0 * found.strength_deviation


def test_where_nothing_attacks_nothing_is_found() -> None:
    team, hazards = Wandering([], seed=3), hazard_map()
    team.walk(hazards, 60.0)
    assert hazards.estimates == ()


def test_a_lone_fault_is_doubted_and_flying_through_unharmed_refutes_it() -> None:
    hazards = hazard_map()
    told(hazards, [NEAR], 0.0, hits=1)
    (first,) = settled(hazards)
    assert 0.5 < first.confidence < 0.99
    told(hazards, [NEAR], STEP_S, recovered=True)
    seen = [first.confidence]
    for step in range(60):
        ring = [(NEAR[0] + x, NEAR[1] + y) for x in (-0.6, 0.0, 0.6) for y in (-0.6, 0.0, 0.6)]
        told(hazards, ring, 1.0 + 1.1 * step)
        for _ in range(30):
            told(hazards, ring, 1.0 + 1.1 * step)
        for estimate in settled(hazards):
            seen.append(estimate.confidence)
    assert seen[-1] < 0.2
    assert not [e for e in hazards.estimates if e.confidence > 0.2]


def test_clear_flights_past_a_zone_narrow_it() -> None:
    hazards = hazard_map()
    told(hazards, [NEAR], 0.0, hits=1)
    (before,) = settled(hazards)
    for step in range(400):
        told(hazards, [(NEAR[0] + 0.7, NEAR[1] + 0.02 * step - 4.0)], STEP_S * (step + 1))
    told(hazards, [], 60.0)
    (after,) = settled(hazards)
    assert after.mean[0] < before.mean[0] - 0.05, "it lies on the side nobody has flown on"
    beyond = [(NEAR[0] + 0.7, NEAR[1])]
    densities = [
        normal_density(np.array(beyond[0]), np.asarray(e.mean), np.asarray(e.covariance))
        for e in (before, after)
    ]
    assert densities[1] < 0.9 * densities[0]


def test_recovery_tells_how_far_a_zone_reaches() -> None:
    widths = []
    for reach in (0.9, 2.4):
        hazards = hazard_map()
        for angle in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
            towards = np.array([np.cos(angle), np.sin(angle)])
            told(hazards, [tuple(np.asarray(NEAR) + 0.3 * towards)], 0.0, hits=1)
            told(hazards, [tuple(np.asarray(NEAR) + (reach - 0.2) * towards)], 0.1, failing=True)
            told(hazards, [tuple(np.asarray(NEAR) + (reach + 0.1) * towards)], 0.2, recovered=True)
        found = settled(hazards)
        widths.append(max(float(np.linalg.det(one.extent)) ** 0.25 for one in found))
        for distance, inside in ((reach - 0.2, True), (reach + 0.1, False)):
            place = np.array([NEAR[0] + distance, NEAR[1]])
            densities = [
                one.strength * normal_density(place, np.asarray(one.mean), np.asarray(one.extent))
                for one in found
            ]
            assert (max(densities) > LAW.recover_density) == inside
    assert widths[0] < widths[1]


def test_the_posterior_is_that_of_another_computation() -> None:
    """Random-walk Metropolis on the raw steps, written apart from the map's own sums."""
    team, hazards = Wandering([zone(NEAR)], seed=8, drawn_to=(NEAR,)), hazard_map()
    team.walk(hazards, 60.0)
    told(hazards, [], 90.0)
    (estimate,) = settled(hazards)
    chain = metropolis(team, np.array([*NEAR, np.log(0.7), 0.0, 0.0, 0.0]))
    mean, deviation = chain[:, :2].mean(axis=0), chain[:, :2].std(axis=0)
    assert np.abs(np.asarray(estimate.mean) - mean) == pytest.approx(0.0, abs=0.6 * deviation.max())
    claimed = np.sqrt(np.diag(estimate.centre_covariance))
    assert (claimed / deviation > 0.6).all()
    assert (claimed / deviation < 1.7).all()
    size = np.exp(2.0 * chain[:, 2]).mean()
    assert np.sqrt(np.linalg.det(estimate.extent)) == pytest.approx(size, rel=0.4)


def metropolis(team: Wandering, start: np.ndarray) -> np.ndarray:
    """Return draws (n, 6) of (x, y, l, a, b, g) given a team's raw steps."""
    places = np.concatenate([step[0] for step in team.steps])
    hits, inside, outside = (
        np.concatenate([step[column] for step in team.steps]) for column in (1, 2, 3)
    )
    near = np.hypot(*(places - NEAR).T) < 5.0
    places, hits, inside, outside = places[near], hits[near], inside[near], outside[near]

    def log_posterior(theta: np.ndarray) -> float:
        turned = np.array([[theta[3], theta[4]], [theta[4], -theta[3]]])
        values, axes = np.linalg.eigh(turned)
        S = np.exp(2.0 * theta[2]) * (axes * np.exp(values)) @ axes.T
        offset = places - theta[:2]
        distance = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(S), offset)
        log_density = theta[5] - 0.5 * distance - np.log(2.0 * np.pi * np.sqrt(np.linalg.det(S)))
        chance = np.minimum(np.exp(log_density) * STEP_S / LAW.period_s, 0.98)
        other = LAW.fault_rate * STEP_S
        held = 1.0 / (1.0 + np.exp(-(log_density - np.log(LAW.recover_density)) / 0.4))
        total = np.log1p(-chance[hits == 0]).sum() + np.log(chance[hits > 0] + other).sum()
        kept = inside & (hits == 0)
        total += first_of_cells(places, kept, np.log(held + 0.02))
        total += first_of_cells(places, outside, np.log(np.maximum(1.0 - held, 0.02)))
        spreads = np.array([LAW.deviation_spread, LAW.elongation, LAW.elongation])
        shape = (theta[2:5] - [np.log(LAW.deviation_m), 0.0, 0.0]) / spreads
        strength = theta[5] / LAW.strength_spread
        return float(total - 0.5 * (shape @ shape + strength * strength))

    dice = np.random.default_rng(11)
    steps = 0.45 * np.array([0.3, 0.3, 0.2, 0.15, 0.15, 0.2])
    now, value, chain = start, log_posterior(start), []
    for _ in range(3_000):
        asked = now + steps * dice.standard_normal(6)
        asked_value = log_posterior(asked)
        if np.log(dice.random()) < asked_value - value:
            now, value = asked, asked_value
        chain.append(now)
    return np.array(chain[500:])


def first_of_cells(places: np.ndarray, chosen: np.ndarray, values: np.ndarray) -> float:
    """Return the sum over cells of the mean of their values: a cell counts once."""
    cells: dict[tuple[int, int], list[float]] = {}
    for place, value in zip(places[chosen], values[chosen], strict=True):
        cell = (int(np.floor(place[0] / 0.25)), int(np.floor(place[1] / 0.25)))
        cells.setdefault(cell, []).append(float(value))
    return sum(float(np.mean(found)) for found in cells.values())


def test_a_vouched_zone_explains_its_hits() -> None:
    hazards = hazard_map()
    hazards.told(((NEAR, ((0.4, 0.0), (0.0, 0.4))),))
    told(hazards, [NEAR], 0.0, hits=2)
    assert not settled(hazards)
    told(hazards, [FAR], 0.1, hits=1)
    (other,) = settled(hazards)
    assert np.hypot(*(np.asarray(other.mean) - FAR)) < 0.5


def test_a_forgotten_zone_comes_back_when_it_hits_again() -> None:
    hazards = hazard_map()
    told(hazards, [NEAR, NEAR], 0.0, hits=1)
    (first,) = settled(hazards)
    hazards.forget(first.key)
    told(hazards, [], 5.0)
    assert not settled(hazards)
    told(hazards, [NEAR], 6.0, hits=1)
    (second,) = settled(hazards)
    assert second.key != first.key
    assert second.since_s == 6.0


def test_a_neighbour_stays_known_when_its_evidence_is_forgotten_too() -> None:
    hazards, beside = hazard_map(), (NEAR[0] + 2.4, NEAR[1])
    for step in range(6):
        told(hazards, [NEAR], STEP_S * step, hits=1)
        told(hazards, [beside], STEP_S * step, hits=1)
        settled(hazards)
    near, before = sorted(hazards.estimates, key=lambda estimate: estimate.mean[0])
    assert before.confidence > 0.9
    hazards.forget(near.key)
    for step in range(10):
        told(hazards, [beside], 1.0 + 1.1 * step)
        settled(hazards)
    (after,) = hazards.estimates
    assert after.key == before.key
    assert after.confidence > 0.9
    assert np.hypot(*(np.asarray(after.mean) - before.mean)) < 0.3


def test_without_anything_it_has_caused_there_is_no_zone() -> None:
    nothing = Marks(np.zeros((0, 2)), np.zeros(0))
    clear = Marks(np.array([NEAR]), np.array([3.0]))
    cloud = hypotheses.fitted(
        LAW,
        Evidence(clear, nothing, nothing, nothing),
        Background(np.zeros(0), np.zeros(0)),
        hypotheses.around(np.array(NEAR), LAW),
        rounds=2,
    )
    assert cloud.log_odds == -np.inf
    assert np.isfinite(cloud.predictive).all()
    assert np.isfinite([*cloud.centre, cloud.strength, cloud.strength_deviation]).all()


def test_another_map_goes_on_with_what_was_believed() -> None:
    team, hazards = Wandering([zone(NEAR)], seed=8, drawn_to=(NEAR,)), hazard_map()
    team.walk(hazards, 60.0)
    (before,) = [e for e in hazards.estimates if e.confidence > 0.9]
    other = hazard_map()
    other.restore(hazards.kept(), 60.0)
    (after,) = [e for e in other.estimates if e.confidence > 0.9]
    assert (after.key, after.since_s) == (before.key, before.since_s)
    assert after.mean == pytest.approx(before.mean, abs=0.1)
    sizes = [np.linalg.det(np.asarray(estimate.covariance)) for estimate in (before, after)]
    assert sizes[1] == pytest.approx(sizes[0], rel=0.5)
    assert after.confidence == pytest.approx(before.confidence, abs=0.05)
    told(other, [NEAR], 61.0, hits=1)
    assert [e.key for e in settled(other) if e.confidence > 0.9] == [before.key]


def test_the_same_evidence_gives_the_same_beliefs_bit_for_bit() -> None:
    found = []
    for _ in range(2):
        team, hazards = Wandering([zone(NEAR)], seed=8, drawn_to=(NEAR,)), hazard_map()
        team.walk(hazards, 20.0)
        found.append(hazards.estimates)
    assert found[0] == found[1] != ()


def test_hits_everywhere_stay_bounded() -> None:
    hazards = hazard_map()
    dice = np.random.default_rng(5)
    for step in range(150):
        places = [tuple(place) for place in dice.uniform((-10.0, -6.0), (10.0, 6.0), (4, 2))]
        told(hazards, places, STEP_S * step, hits=1)
        hazards.update()
    for estimate in hazards.estimates:
        numbers = np.array([*estimate.mean, *np.ravel(estimate.covariance), estimate.confidence])
        assert np.isfinite(numbers).all()
        assert np.linalg.eigvalsh(np.asarray(estimate.covariance)).min() > 0.0
    assert len(hazards.estimates) <= MOST_ZONES


def test_claimed_uncertainty_holds_the_truth() -> None:
    """Worlds drawn from the prior: the 95 % ellipse of the centre holds it nearly that often."""
    inside = []
    for seed in range(9):
        dice = np.random.default_rng(1000 + seed)
        deviation = LAW.deviation_m * np.exp(LAW.deviation_spread * dice.standard_normal())
        truth = (dice.uniform((-6.0, -3.0), (6.0, 3.0)), deviation**2 * np.eye(2))
        place = (float(truth[0][0]), float(truth[0][1]))
        team, hazards = Wandering([truth], seed=seed, drawn_to=(place,)), hazard_map()
        team.walk(hazards, 25.0)
        inside += [error(e, truth) < 5.99 for e in hazards.estimates if e.confidence > 0.5]
    assert len(inside) >= 5
    assert np.mean(inside) >= 0.7


def test_weights_of_a_cloud_stay_sound_with_overwhelming_evidence() -> None:
    hazards = hazard_map()
    for step in range(100):
        told(hazards, [NEAR], STEP_S * step, hits=3)
        hazards.update()
    best = max(settled(hazards), key=lambda e: e.confidence)
    assert best.confidence == pytest.approx(1.0)
    assert np.hypot(*(np.asarray(best.mean) - NEAR)) < 0.4
    assert best.strength > 1.0, "more hits than the law allows"
