"""What is made of a problem that is not sound, number by number."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solver.arrays import FloatArray, frozen, frozen_bool
from solver.directives import Weights
from solver.objective import PRIOR_GREATEST, PRIOR_LEAST
from solver.problem import Dynamics, Problem
from solver.repair import FAR_M, control_limits, is_solvable, plannable, repaired, subset
from tests.solver.problems import random_problem

PER_ROBOT = (
    "positions", "velocities", "control_lower", "control_upper", "speed_limit", "sees", "replan",
)  # fmt: skip
NUMERIC = (
    "positions", "velocities", "control_lower", "control_upper", "speed_limit", "field_lower",
    "field_upper", "target_means", "target_priors", "target_growth", "obstacles",
)  # fmt: skip
OF_ZONES = ("centres", "covariances", "margins", "quantiles", "severities")
SCALARS = ("separation_weight", "field_weight", "min_dist_m")
NAN, INF = math.nan, math.inf


def sound(**changes: Any) -> Problem:
    return replace(random_problem(3, 3, 4, 2, 2, obstacles=3), **changes)


def with_entry(values: FloatArray, at: tuple[int, ...], entry: float) -> FloatArray:
    changed = values.copy()
    changed[at] = entry
    return frozen(changed)


def with_zone_entry(problem: Problem, kind: str, name: str, entry: float) -> Problem:
    table = getattr(problem, kind)
    values = getattr(table, name)
    changed: dict[str, Any] = {name: with_entry(values, (1,) + (0,) * (values.ndim - 1), entry)}
    fields: dict[str, Any] = {kind: replace(table, **changed)}
    return replace(problem, **fields)


def differing(one: Problem, other: Problem) -> set[str]:
    """Return the names of the fields that are not equal."""
    names = {
        n for n in (*NUMERIC, "sees") if not np.array_equal(getattr(one, n), getattr(other, n))
    }
    names |= {n for n in ("weights", *SCALARS) if getattr(one, n) != getattr(other, n)}
    for kind in ("sensing", "communication"):
        tables = getattr(one, kind), getattr(other, kind)
        for name in (*OF_ZONES, "known"):
            if not np.array_equal(*(getattr(table, name) for table in tables)):
                names.add(f"{kind}.{name}")
    return names


@pytest.mark.parametrize(
    ("changes", "answer"),
    [
        ({}, True),
        ({"robot_ids": ()}, False),
        ({"horizon": 1}, True),
        ({"horizon": 0}, False),
        ({"step_s": 1e-3}, True),
        ({"step_s": 0.0}, False),
        ({"step_s": -0.5}, False),
        ({"step_s": INF}, False),
        ({"step_s": NAN}, False),
    ],
)
def test_a_team_a_horizon_and_a_step_are_needed(changes: dict[str, Any], answer: bool) -> None:
    assert is_solvable(sound(**changes)) is answer


def test_a_state_that_is_no_number_cannot_be_planned_for() -> None:
    problem = sound()
    lost = replace(problem, positions=with_entry(problem.positions, (1, 1), NAN))
    assert plannable(lost).tolist() == [True, False, True]
    spinning = replace(problem, velocities=with_entry(problem.velocities, (2, 0), INF))
    assert plannable(spinning).all(), "a single integrator's velocity is no state"
    spinning = replace(spinning, dynamics=Dynamics.DOUBLE_INTEGRATOR)
    assert plannable(spinning).tolist() == [True, True, False]


def test_a_subset_keeps_the_rows_of_its_robots_and_all_the_rest() -> None:
    plans = np.random.default_rng(0).normal(size=(3, 2, 2))
    problem = sound(previous=frozen(plans), replan=frozen_bool([True, False, False]))
    keep = np.array([True, False, True])
    part = subset(problem, keep)
    assert part.robot_ids == (problem.robot_ids[0], problem.robot_ids[2])
    for name in PER_ROBOT:
        np.testing.assert_array_equal(getattr(part, name), getattr(problem, name)[keep])
    for kind in ("sensing", "communication"):
        whole, cut = getattr(problem, kind), getattr(part, kind)
        np.testing.assert_array_equal(cut.known, whole.known[keep])
        assert cut.centres is whole.centres
    assert part.previous is not None
    np.testing.assert_array_equal(part.previous, plans[keep])
    assert part.target_means is problem.target_means
    assert subset(replace(problem, previous=None), keep).previous is None


@pytest.mark.parametrize("entry", [NAN, INF, -INF, 1.01 * FAR_M, -1.01 * FAR_M])
@pytest.mark.parametrize("name", NUMERIC)
def test_one_number_out_of_order_anywhere_is_noticed(name: str, entry: float) -> None:
    problem = sound()
    values = getattr(problem, name)
    changed: dict[str, Any] = {name: with_entry(values, (0,) * values.ndim, entry)}
    fixed = repaired(replace(problem, **changed))
    assert np.isfinite(getattr(fixed, name)).all()
    assert (np.abs(getattr(fixed, name)) <= FAR_M).all()


@pytest.mark.parametrize("kind", ["sensing", "communication"])
@pytest.mark.parametrize("name", OF_ZONES)
def test_one_number_of_a_zone_out_of_order_is_noticed(name: str, kind: str) -> None:
    problem = sound()
    fixed = repaired(with_zone_entry(problem, kind, name, NAN))
    assert np.isfinite(getattr(getattr(fixed, kind), name)).all()
    changed = differing(fixed, problem)
    if name == "covariances":
        assert changed == {f"{kind}.covariances"}
    else:
        assert changed == {f"{kind}.{name}", f"{kind}.known"}
        known = getattr(problem, kind).known.copy()
        known[:, 1] = False
        np.testing.assert_array_equal(getattr(fixed, kind).known, known)


def test_a_number_as_large_as_may_be_is_an_ordinary_one() -> None:
    problem = sound()
    far = replace(problem, positions=with_entry(problem.positions, (0, 0), FAR_M))
    assert repaired(far) is far
    assert repaired(sound(previous=frozen(np.zeros((3, 2, 2))))).previous is not None


def test_what_is_in_order_stays_as_it_is() -> None:
    problem = sound()
    fixed = repaired(replace(problem, min_dist_m=-1.0))
    assert differing(fixed, problem) == {"min_dist_m"}
    assert fixed.min_dist_m == 0.0
    assert fixed.robot_ids == problem.robot_ids


@pytest.mark.parametrize(
    ("given", "taken"), [(-1.0, 0.0), (NAN, 0.0), (INF, FAR_M), (-INF, 0.0), (0.0, 0.0)]
)
def test_weights_and_the_least_distance_are_no_less_than_zero(given: float, taken: float) -> None:
    for name in SCALARS:
        changes: dict[str, Any] = {name: given}
        assert getattr(repaired(sound(**changes)), name) == taken
    for at in range(4):
        weights = [1.0, 2.0, 3.0, 4.0]
        weights[at] = given
        expected = [1.0, 2.0, 3.0, 4.0]
        expected[at] = taken
        assert repaired(sound(weights=Weights(*weights))).weights == Weights(*expected)


def test_control_bounds_are_ordered_and_one_that_is_no_number_allows_no_motion() -> None:
    lower = frozen([[0.5, -0.5], [NAN, -0.5], [-0.5, -2.0 * FAR_M]])
    upper = frozen([[-0.5, 0.5], [0.5, INF], [0.5, 0.5]])
    problem = repaired(sound(control_lower=lower, control_upper=upper))
    expected = [[-0.5, -0.5], [0.0, -0.5], [-0.5, 0.0]], [[0.5, 0.5], [0.5, 0.0], [0.5, 0.5]]
    np.testing.assert_array_equal(problem.control_lower, expected[0])
    np.testing.assert_array_equal(problem.control_upper, expected[1])
    low, high = control_limits(sound(control_lower=lower, control_upper=upper))
    np.testing.assert_array_equal(low, expected[0])
    np.testing.assert_array_equal(high, expected[1])
    at_most = frozen(np.full((3, 2), FAR_M))
    np.testing.assert_array_equal(control_limits(sound(control_upper=at_most))[1], FAR_M)


def test_states_are_brought_into_range() -> None:
    problem = sound()
    fixed = repaired(
        replace(
            problem,
            positions=with_entry(problem.positions, (0, 0), -1e300),
            velocities=frozen([[NAN, 0.1], [INF, 0.2], [-INF, 0.3]]),
            speed_limit=frozen([-0.6, NAN, 0.7]),
        )
    )
    assert fixed.positions[0, 0] == -FAR_M
    np.testing.assert_array_equal(fixed.positions[1:], problem.positions[1:])
    np.testing.assert_array_equal(fixed.velocities, [[0.0, 0.1], [FAR_M, 0.2], [-FAR_M, 0.3]])
    np.testing.assert_array_equal(fixed.speed_limit, [0.6, 0.0, 0.7])


def test_a_field_edge_that_is_no_number_is_none_and_edges_are_ordered() -> None:
    fixed = repaired(sound(field_lower=frozen([NAN, 3.0]), field_upper=frozen([NAN, -2.0])))
    np.testing.assert_array_equal(fixed.field_lower, [-FAR_M, -2.0])
    np.testing.assert_array_equal(fixed.field_upper, [FAR_M, 3.0])


def test_a_target_that_is_nowhere_at_some_step_is_seen_by_nobody() -> None:
    problem = sound()
    fixed = repaired(
        replace(problem, target_means=with_entry(problem.target_means, (1, 2, 0), NAN))
    )
    sees = problem.sees.copy()
    assert sees[:, 2].any()
    sees[:, 2] = False
    np.testing.assert_array_equal(fixed.sees, sees)
    assert fixed.target_means[1, 2, 0] == 0.0
    assert differing(fixed, problem) == {"sees", "target_means"}


def test_covariances_become_symmetric_and_positive_definite() -> None:
    skew = np.array([[2.0, 0.5], [0.1, 1.0]])
    flat = np.array([[1.0, 2.0], [2.0, 1.0]])
    vast = np.diag([1e9, 2.0])
    nothing = np.full((2, 2), NAN)
    fixed = repaired(sound(target_priors=frozen([skew, flat, vast, nothing])))
    np.testing.assert_allclose(fixed.target_priors[0], [[2.0, 0.3], [0.3, 1.0]])
    values = np.linalg.eigvalsh(fixed.target_priors)
    np.testing.assert_allclose(values[1], [PRIOR_LEAST, 3.0])
    np.testing.assert_allclose(values[2], [2.0, PRIOR_GREATEST])
    assert values[3, 1] == pytest.approx(PRIOR_GREATEST)
    endless = [np.diag([INF, 2.0]), np.diag([-INF, 2.0]), np.eye(2), np.eye(2)]
    values = np.linalg.eigvalsh(repaired(sound(target_priors=frozen(endless))).target_priors)
    np.testing.assert_allclose(values[0], [2.0, PRIOR_GREATEST])
    np.testing.assert_allclose(values[1], [PRIOR_LEAST, 2.0])
    np.testing.assert_array_equal(fixed.target_priors, np.swapaxes(fixed.target_priors, 1, 2))
    shrinking = sound()
    growth = with_entry(shrinking.target_growth, (1, 0), 0.0)
    growth = with_entry(growth, (1, 0, 0, 0), -1.0)
    fixed = repaired(replace(shrinking, target_growth=growth))
    np.testing.assert_allclose(fixed.target_growth[1, 0], 0.0, atol=1e-12)
    assert differing(fixed, shrinking) == {"target_growth"}


def test_bounds_of_zones_that_would_draw_robots_in_become_nothing() -> None:
    problem = sound()
    for name in ("quantiles", "severities"):
        fixed = repaired(replace(with_zone_entry(problem, "sensing", name, -1.0), min_dist_m=-1.0))
        assert getattr(fixed.sensing, name)[1] == 0.0
        assert getattr(fixed.sensing, name)[0] == getattr(problem.sensing, name)[0]


def test_obstacles_that_are_nowhere_are_left_out() -> None:
    places = frozen([[1.0, 2.0], [NAN, 0.0], [3.0, 1e300]])
    np.testing.assert_array_equal(
        repaired(sound(obstacles=places)).obstacles, [[1.0, 2.0], [3.0, FAR_M]]
    )


@pytest.mark.parametrize(
    "plans", [np.zeros((3, 1, 2)), np.zeros((2, 2, 2)), np.full((3, 2, 2), NAN)]
)
def test_a_last_plan_of_another_shape_or_of_no_numbers_is_none(plans: FloatArray) -> None:
    assert repaired(sound(previous=frozen(plans))).previous is None


def test_a_last_plan_outlives_a_repair() -> None:
    plans = frozen(np.full((3, 2, 2), 0.25))
    fixed = repaired(sound(previous=plans, min_dist_m=NAN))
    assert fixed.previous is plans
