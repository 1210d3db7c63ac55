"""No two robots ever nearer than the least distance, whatever the engine wants."""

from dataclasses import replace
from typing import Any

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


def test_near_enough_to_look_at_and_far_enough_to_be_left_alone() -> None:
    problem = team(np.array([[0.0, 0.0], [0.9, 0.0]]))
    wanted = np.array([[0.5, 0.1], [-0.5, 0.1]])
    # 0.25 m to spare each, in half a second: just what they want.
    lower, upper = control_box(problem)
    assert separated(problem, wanted, lower[:, 0], upper[:, 0]) is wanted
    nearer = replace(problem, positions=frozen([[0.0, 0.0], [0.8, 0.0]]))
    first = filtered(nearer, wanted)
    np.testing.assert_allclose(first, [[0.4, 0.1], [-0.4, 0.1]])
    np.testing.assert_array_equal(wanted, [[0.5, 0.1], [-0.5, 0.1]])


@pytest.mark.parametrize("turn", np.arange(0.05, 2.0 * np.pi, 0.5))
def test_of_two_on_one_spot_each_may_go_where_the_other_may_not(turn: float) -> None:
    wanted = 0.4 * np.array([[np.cos(turn), np.sin(turn)]] * 2)
    first = filtered(team(np.zeros((2, 2))), wanted)
    kept = [np.array_equal(found, asked) for found, asked in zip(first, wanted, strict=True)]
    assert sorted(kept) == [False, True]


def test_three_on_one_spot_may_all_part() -> None:
    problem = team(np.ones((3, 2)))
    rng = np.random.default_rng(0)
    gaps = [
        pdist(problem.step_s * filtered(problem, rng.uniform(-0.5, 0.5, size=(3, 2)))).min()
        for _ in range(200)
    ]
    assert max(gaps) > 0.2


def test_who_stands_on_an_obstacle_may_leave_it_on_one_side() -> None:
    problem = replace(team(np.array([[1.0, 1.0]])), obstacles=frozen([[1.0, 1.0]]))
    turns = np.arange(0.01, 2.0 * np.pi, 0.1)
    ways = 0.4 * np.stack((np.cos(turns), np.sin(turns)), axis=1)
    free = sum(np.array_equal(filtered(problem, way[None])[0], way) for way in ways)
    assert free == pytest.approx(len(ways) / 2.0, abs=1.5)


def test_a_team_on_one_spot_beside_an_obstacle_keeps_away_from_it() -> None:
    problem = replace(team(np.zeros((2, 2))), obstacles=frozen([[0.5, 0.0]]))
    first = filtered(problem, np.array([[0.5, 0.0], [0.5, 0.0]]))
    assert (first[:, 0] <= 0.1 + 1e-9).all()


def moving(positions: FloatArray, velocities: FloatArray, **changes: Any) -> Problem:
    problem = team(positions, Dynamics.DOUBLE_INTEGRATOR)
    return replace(problem, velocities=frozen(velocities), **changes)


@pytest.mark.parametrize(
    ("gap", "speed"), [(0.4, 0.0), (0.6, 0.0), (1.0, 0.2), (1.4, 0.5), (0.8, -0.3), (0.5, 0.1)]
)
def test_a_double_integrator_keeps_the_way_it_needs_to_brake(gap: float, speed: float) -> None:
    """Two that approach each other along x at one speed; half of what is left is each one's."""
    problem = moving(np.array([[0.0, 0.0], [gap, 0.0]]), np.array([[speed, 0.1], [-speed, 0.1]]))
    first = filtered(problem, np.array([[0.5, 0.2], [-0.5, 0.2]]))
    h, a = 0.5, 0.5
    spare = 0.5 * (gap - 0.4) - 0.5 * h * speed
    # After the step it moves at w and needs w^2 / 2a + w h / 2 to come to rest.
    w = a * (np.sqrt(h * h + 2.0 * spare / a) - h) if spare >= 0.0 else 2.0 * spare / h
    most = float(np.clip((w - speed) / h, -0.5, 0.5))
    np.testing.assert_allclose(first, [[most, 0.2], [-most, 0.2]], atol=1e-9)


def test_a_robot_brakes_as_its_weaker_side_allows() -> None:
    lower, upper = frozen([[-0.5, -0.4], [-0.2, -0.5]]), frozen([[0.3, 0.5], [0.5, 0.5]])
    problem = moving(
        np.array([[0.0, 0.0], [1.0, 0.0]]),
        np.array([[0.2, 0.0], [-0.2, 0.0]]),
        control_lower=lower,
        control_upper=upper,
    )
    first = filtered(problem, np.array([[0.3, 0.0], [-0.2, 0.0]]))
    for row, a in enumerate((0.3, 0.2)):
        w = a * (np.sqrt(0.25 + 2.0 * 0.25 / a) - 0.5)
        most = min((w - 0.2) / 0.5, (0.3, 0.2)[row])
        assert abs(first[row, 0]) == pytest.approx(most, abs=1e-9)


@pytest.mark.parametrize("obstacle", [False, True])
def test_fast_ones_see_each_other_in_time(obstacle: bool) -> None:
    """From afar at two metres a second, with half a metre per second and second to brake."""
    places = np.array([[-12.0, 0.0]] if obstacle else [[-12.0, 0.05], [12.0, -0.05]])
    speeds = np.array([[2.0, 0.0], [-2.0, 0.0]])[: len(places)]
    still = frozen([[0.0, 0.0]]) if obstacle else frozen(np.zeros((0, 2)))
    problem = moving(places, speeds, obstacles=still)
    problem = replace(
        problem,
        speed_limit=frozen(np.full(len(places), 2.0)),
        field_lower=frozen([-50.0, -50.0]),
        field_upper=frozen([50.0, 50.0]),
    )
    nearest = np.inf
    for _ in range(60):
        first = filtered(problem, np.sign(speeds) * 0.5)
        positions, velocities = rollout(problem, first[:, None])
        everyone = np.concatenate((positions[:, 0], still))
        nearest = min(nearest, float(pdist(everyone).min()))
        problem = replace(
            problem, positions=frozen(positions[:, 0]), velocities=frozen(velocities[:, 0])
        )
    assert problem.min_dist_m - 1e-7 <= nearest < 1.0


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_where_nothing_obeys_the_worst_violation_is_nearly_least(seed: int) -> None:
    """Too fast to stop for two others at once; against a fine grid over the limits."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0.0, 2.0 * np.pi) + np.array([0.0, rng.uniform(0.5, 2.5)])
    normals = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    speed = 2.0 * normals.mean(axis=0)
    places = np.concatenate((np.zeros((1, 2)), 0.6 * normals))
    problem = moving(places, np.concatenate((speed[None], np.zeros((2, 2)))))
    first = filtered(problem, rng.uniform(-0.5, 0.5, size=(3, 2)))[0]
    h = problem.step_s
    closing = normals @ speed
    spare = 0.1 - 0.5 * h * closing
    w = np.where(
        spare >= 0.0, 0.5 * (np.sqrt(h * h + 4.0 * np.maximum(spare, 0.0)) - h), 2.0 * spare / h
    )
    limits = (w - closing) / h
    axis = np.linspace(-0.5, 0.5, 101)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    least = (grid @ normals.T - limits).max(axis=1).min()
    assert (normals @ first - limits).max() <= max(least, 0.0) + 0.3
    assert (np.abs(first) <= 0.5).all()
