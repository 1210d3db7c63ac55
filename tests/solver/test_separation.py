"""No two robots ever nearer than the least distance, whatever the engine wants."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.distance import pdist

from solver.arrays import FloatArray, frozen
from solver.bounds import control_box, rollout
from solver.problem import Dynamics, Problem
from solver.separation import separated
from tests.solver.problems import random_problem


def team(positions: FloatArray, dynamics: Dynamics = Dynamics.SINGLE_INTEGRATOR) -> Problem:
    problem = random_problem(0, len(positions), 1, 0, dynamics=dynamics, obstacles=0, room=20.0)
    return replace(
        problem, positions=frozen(positions), velocities=frozen(np.zeros_like(positions))
    )


def filtered(problem: Problem, wanted: FloatArray) -> FloatArray:
    lower, upper = control_box(problem)
    lower, upper = lower[:, 0], upper[:, 0]
    return separated(problem, np.clip(wanted, lower, upper), lower, upper)


def spaced(rng: np.random.Generator, count: int, room: float, least: float) -> FloatArray:
    places: list[FloatArray] = []
    while len(places) < count:
        place = rng.uniform(-room, room, size=2)
        if all(np.hypot(*(place - other)) > least for other in places):
            places.append(place)
    return np.array(places)


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 8))
def test_a_crowd_of_single_integrators_keeps_its_distance_all_along(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    problem = team(spaced(rng, count, 1.5, 0.41))
    for _ in range(15):
        goals = rng.uniform(-1.0, 1.0, size=(count, 2))
        wanted = (goals - problem.positions) / problem.step_s
        first = filtered(problem, wanted)
        for share in (0.25, 0.5, 0.75, 1.0):
            along = problem.positions + share * problem.step_s * first
            assert pdist(along).min() >= problem.min_dist_m - 1e-7
        problem = replace(problem, positions=frozen(along))


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 5))
def test_a_crowd_of_double_integrators_keeps_its_distance(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    problem = team(spaced(rng, count, 3.0, 0.6), Dynamics.DOUBLE_INTEGRATOR)
    for _ in range(40):
        goals = rng.uniform(-0.5, 0.5, size=(count, 2))
        first = filtered(problem, goals - problem.positions - 0.5 * problem.velocities)
        plan = np.repeat(first[:, None], 1, axis=1)
        positions, velocities = rollout(problem, plan)
        assert pdist(positions[:, 0]).min() >= problem.min_dist_m - 1e-7
        problem = replace(
            problem, positions=frozen(positions[:, 0]), velocities=frozen(velocities[:, 0])
        )


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 6))
def test_robots_too_near_already_never_come_nearer(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    problem = team(rng.uniform(-0.2, 0.2, size=(count, 2)))
    before = pdist(problem.positions)
    first = filtered(problem, rng.uniform(-1.0, 1.0, size=(count, 2)))
    after = pdist(problem.positions + problem.step_s * first)
    assert (after >= np.minimum(before, problem.min_dist_m) - 1e-7).all()


def test_robots_on_one_spot_may_part() -> None:
    problem = team(np.zeros((2, 2)))
    moves = [filtered(problem, np.array([d, -d])) for d in np.array([[0.5, 0.0], [-0.5, 0.0]])]
    gaps = [float(pdist(problem.step_s * move)[0]) for move in moves]
    assert max(gaps) > 0.4


def test_an_obstacle_is_kept_away_from_like_a_team_mate() -> None:
    problem = replace(team(np.array([[0.0, 0.0]])), obstacles=frozen([[0.5, 0.0]]))
    first = filtered(problem, np.array([[0.5, 0.3]]))
    # Half of the 0.1 m to spare, in one step of 0.5 s; sideways nothing is in the way.
    np.testing.assert_allclose(first, [[0.1, 0.3]], atol=1e-9)


def test_commands_of_robots_far_apart_are_left_alone() -> None:
    problem = team(np.array([[0.0, 0.0], [5.0, 5.0]]))
    wanted = np.array([[0.5, 0.5], [-0.5, -0.5]])
    lower, upper = control_box(problem)
    assert separated(problem, wanted, lower[:, 0], upper[:, 0]) is wanted


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 7))
def test_the_replacement_is_the_nearest_that_obeys(seed: int, count: int) -> None:
    """Against a general solver on the same half-planes, which are written out here."""
    rng = np.random.default_rng(seed)
    problem = team(spaced(rng, count, 1.0, 0.4))
    wanted = rng.uniform(-0.5, 0.5, size=(count, 2))
    first = filtered(problem, wanted)
    x = problem.positions
    halves = []
    for other in x[1:]:
        offset = other - x[0]
        distance = np.hypot(*offset)
        halves.append((offset / distance, (distance - problem.min_dist_m) / 2.0))
    found = minimize(
        lambda u: float((u - wanted[0]) @ (u - wanted[0])),
        np.zeros(2),
        bounds=[(-0.5, 0.5)] * 2,
        constraints=[
            {"type": "ineq", "fun": lambda u, n=n, room=room: room - problem.step_s * (n @ u)}
            for n, room in halves
        ],
        method="SLSQP",
        options={"ftol": 1e-14},
    )
    for n, room in halves:
        assert problem.step_s * (n @ first[0]) <= room + 1e-8
    ours = float((first[0] - wanted[0]) @ (first[0] - wanted[0]))
    assert ours <= found.fun + 1e-6


def test_the_field_gives_way_before_the_distance() -> None:
    """Outside the field, with somebody on the way back."""
    problem = team(np.array([[20.5, 0.0], [20.0, 0.0]]))
    assert control_box(problem)[1][0, 0, 0] < 0.0
    first = filtered(problem, np.array([[-0.5, 0.0], [0.0, 0.0]]))
    after = problem.positions + problem.step_s * first
    assert float(pdist(after)[0]) >= problem.min_dist_m - 1e-9
    assert (np.abs(first) <= 0.5).all()


@pytest.mark.parametrize("dynamics", list(Dynamics))
def test_teams_beyond_all_pairs_are_filtered_alike(dynamics: Dynamics) -> None:
    """A big team next to a copy of a small one: the copy must get the same commands."""
    rng = np.random.default_rng(2)
    small = team(spaced(rng, 30, 2.5, 0.45), dynamics)
    wanted = rng.uniform(-0.5, 0.5, size=(30, 2))
    alone = filtered(small, wanted)
    far = spaced(rng, 50, 15.0, 0.45) + np.array([200.0, 0.0])
    big = replace(
        team(np.concatenate((small.positions, far)), dynamics),
        field_upper=frozen([500.0, 500.0]),
    )
    together = filtered(big, np.concatenate((wanted, np.zeros((50, 2)))))
    np.testing.assert_allclose(together[:30], alone, atol=1e-12)
    assert not np.array_equal(alone, wanted)
