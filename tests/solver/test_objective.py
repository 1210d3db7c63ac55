"""The objective against plain loops over the formulas, its gradient against differences."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import objective
from solver.arrays import FloatArray, frozen, frozen_bool
from solver.objective import MATE_SMOOTHING_M, TARGET_FLOOR_M, ZONE_SMOOTHING_M
from solver.problem import Dynamics, Problem, ZoneTable
from tests.solver.problems import DYNAMICS, coincident, random_controls, random_problem

seeds = st.integers(0, 2**32 - 1)
J = np.array([[0.0, -1.0], [1.0, 0.0]])


def flown(problem: Problem, controls: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Step by step."""
    h, positions, velocities = problem.step_s, [], []
    x, v = problem.positions.copy(), problem.velocities.copy()
    for k in range(problem.horizon):
        u = controls[:, k]
        if problem.dynamics is Dynamics.SINGLE_INTEGRATOR:
            x, v = x + h * u, u
        else:
            x, v = x + h * v + 0.5 * h * h * u, v + h * u
        positions.append(x)
        velocities.append(v)
    return np.stack(positions, axis=1), np.stack(velocities, axis=1)


def distance(a: FloatArray, b: FloatArray, e: float) -> float:
    return float(np.sqrt((a - b) @ (a - b) + e * e) - e)


def plain_trace(problem: Problem, X: FloatArray, j: int) -> float:
    values, vectors = np.linalg.eigh(problem.target_priors[j])
    P = (vectors * np.clip(values, 1e-6, 1e4)) @ vectors.T
    s, total = problem.sensor, 0.0
    for k in range(problem.horizon):
        if k:
            P = P + problem.target_growth[k, j]
        Y = np.linalg.inv(P)
        for i in np.flatnonzero(problem.sees[:, j]):
            p = X[i, k] - problem.target_means[k, j]
            rho = np.sqrt(p @ p + TARGET_FLOOR_M**2)
            Y += s.range_peak * np.exp(-s.range_shape * rho) * np.outer(p, p) / rho**2
            q = J @ p
            Y += s.bearing_peak * np.exp(-s.bearing_shape * rho) * np.outer(q, q) / rho**4
        P = np.linalg.inv(Y)
        total += float(np.trace(P))
    return total


def plain_spread(x: FloatArray, mates: list[FloatArray], e: float, tau: float) -> float:
    if not mates:
        return 0.0
    distances = np.array([distance(x, mate, e) for mate in mates])
    top = float(distances.max())
    return top + tau * float(np.log(np.sum(np.exp((distances - top) / tau)))) if tau else top


def plain_hinge(table: ZoneTable, z: int, x: FloatArray, factor: float, e: float) -> float:
    a, S = table.centres[z] - x, table.covariances[z]
    spread = (a @ S @ a + 0.5 * e * e * np.trace(S)) / (a @ a + e * e)
    g = np.sqrt(a @ a + e * e) - e - table.quantiles[z] * np.sqrt(spread)
    g -= table.margins[z] * factor
    return float(table.severities[z] * max(0.0, -g) ** 2)


def plain_leaving(problem: Problem, x: FloatArray, v: FloatArray, limit: float) -> float:
    out = np.maximum(0.0, problem.field_lower - x) + np.maximum(0.0, x - problem.field_upper)
    fast = np.maximum(0.0, np.abs(v) - limit)
    if problem.dynamics is Dynamics.SINGLE_INTEGRATOR:
        fast = np.zeros(2)
    return problem.field_weight * float(out @ out + fast @ fast)


def plain_cost(problem: Problem, controls: FloatArray, e: float, tau: float) -> float:
    """The formulas, one pair at a time."""
    X, V = flown(problem, controls)
    M, N = problem.sees.shape
    w, total = problem.weights, problem.weights.control * float(np.sum(controls**2))
    total += w.tracking * sum(plain_trace(problem, X, j) for j in range(N))
    for i, k in np.ndindex(M, problem.horizon):
        x = X[i, k]
        spread = plain_spread(x, [X[m, k] for m in range(M) if m != i], e, tau)
        for z in np.flatnonzero(problem.sensing.known[i]):
            total += w.sensing * plain_hinge(problem.sensing, int(z), x, 1.0, e)
        for z in np.flatnonzero(problem.communication.known[i]):
            total += w.communication * plain_hinge(problem.communication, int(z), x, spread, e)
        for other in [*X[:i, k], *problem.obstacles]:
            short = max(0.0, problem.min_dist_m - distance(x, other, e))
            total += problem.separation_weight * short**2
        if k:
            total += plain_leaving(problem, x, V[i, k], float(problem.speed_limit[i]))
    return float(total)


@settings(max_examples=40)
@given(
    seed=seeds,
    robots=st.integers(1, 4),
    targets=st.integers(0, 4),
    zones=st.integers(0, 3),
    horizon=st.integers(1, 4),
    obstacles=st.integers(0, 2),
    dynamics=st.sampled_from(DYNAMICS),
)
def test_cost_is_the_plain_sum(
    seed: int,
    robots: int,
    targets: int,
    zones: int,
    horizon: int,
    obstacles: int,
    dynamics: Dynamics,
) -> None:
    problem = random_problem(seed, robots, targets, zones, horizon, dynamics, obstacles)
    controls = random_controls(seed, problem)
    smooth = plain_cost(problem, controls, ZONE_SMOOTHING_M, MATE_SMOOTHING_M)
    assert objective.cost(problem, controls) == pytest.approx(smooth, rel=1e-10)
    exact = plain_cost(problem, controls, 0.0, 0.0)
    assert objective.exact_cost(problem, controls) == pytest.approx(exact, rel=1e-7, abs=1e-9)


def differences(problem: Problem, controls: FloatArray, step: float = 1e-6) -> FloatArray:
    result = np.zeros_like(controls)
    for index in np.ndindex(*controls.shape):
        ahead, behind = controls.copy(), controls.copy()
        ahead[index] += step
        behind[index] -= step
        rise = objective.cost(problem, ahead) - objective.cost(problem, behind)
        result[index] = rise / (2.0 * step)
    return result


@settings(max_examples=60)
@given(
    seed=seeds,
    horizon=st.integers(1, 4),
    dynamics=st.sampled_from(DYNAMICS),
    room=st.sampled_from([0.3, 1.0, 4.0]),
)
def test_gradient_is_the_slope(seed: int, horizon: int, dynamics: Dynamics, room: float) -> None:
    problem = random_problem(seed, horizon=horizon, dynamics=dynamics, room=room)
    controls = random_controls(seed, problem)
    analytic = objective.gradient(problem, controls)
    scale = 1.0 + float(np.abs(analytic).max())
    np.testing.assert_allclose(
        analytic, differences(problem, controls), rtol=1e-4, atol=2e-5 * scale
    )


@settings(max_examples=20)
@given(seed=seeds, horizon=st.integers(1, 3))
def test_gradient_is_the_slope_where_everything_coincides(seed: int, horizon: int) -> None:
    problem = coincident(random_problem(seed, horizon=horizon))
    controls = np.zeros((3, horizon, 2))
    analytic = objective.gradient(problem, controls)
    assert np.isfinite(analytic).all()
    scale = 1.0 + float(np.abs(analytic).max())
    np.testing.assert_allclose(
        analytic, differences(problem, controls, 1e-7), rtol=1e-3, atol=1e-4 * scale
    )


def test_large_teams_find_the_same_close_pairs() -> None:
    """Beyond 64 robots the pairs come from a tree: the cost of two halves plus nothing."""
    problem = random_problem(1, robots=70, targets=10, room=6.0, horizon=2)
    controls = random_controls(1, problem)
    expected = plain_cost(problem, controls, ZONE_SMOOTHING_M, MATE_SMOOTHING_M)
    assert objective.terms(problem, controls).separation > 0.0
    assert objective.cost(problem, controls) == pytest.approx(expected, rel=1e-9)


def test_an_indefinite_prior_is_taken_as_a_tiny_one() -> None:
    problem = random_problem(3, horizon=3)
    priors = problem.target_priors.copy()
    priors[0] = [[0.1, 0.4], [0.4, 0.1]]
    broken = replace(problem, target_priors=frozen(priors))
    assert 0.0 < objective.cost(broken, np.zeros((3, 3, 2))) < np.inf


def test_an_empty_team_costs_its_unseen_targets() -> None:
    problem = random_problem(0, robots=0, targets=3, horizon=2, obstacles=0)
    nothing = np.zeros((0, 2, 2))
    traces = np.trace(problem.target_priors, axis1=1, axis2=2).sum()
    later = traces + np.trace(problem.target_growth[1], axis1=1, axis2=2).sum()
    assert objective.cost(problem, nothing) == pytest.approx(10.0 * (traces + later))
    assert objective.gradient(problem, nothing).shape == (0, 2, 2)


def test_exact_communication_is_the_papers_where_some_robots_know_some_zones() -> None:
    problem = random_problem(4, 4, 0, 2, 2, room=0.8)
    known = np.array([[True, False], [False, False], [True, True], [False, False]])
    problem = replace(
        problem, communication=replace(problem.communication, known=frozen_bool(known))
    )
    controls = random_controls(1, problem)
    positions, _ = objective.rollout(problem, controls)
    table, total = problem.communication, 0.0
    for k in range(2):
        for robot, zone in np.argwhere(known).tolist():
            x = positions[:, k]
            spread = max(np.linalg.norm(x[robot] - mate) for mate in np.delete(x, robot, axis=0))
            away = table.centres[zone] - x[robot]
            n = away / np.linalg.norm(away)
            radius = table.quantiles[zone] * np.sqrt(n @ table.covariances[zone] @ n)
            g = np.linalg.norm(away) - radius - table.margins[zone] * spread
            total += table.severities[zone] * max(0.0, -g) ** 2
    found = objective.exact_terms(problem, controls).communication
    assert found == pytest.approx(problem.weights.communication * total, rel=1e-6)
    assert found > 0.0


def test_speed_beyond_its_limit_costs_from_the_second_step_on() -> None:
    problem = random_problem(0, 1, 0, 0, 3, Dynamics.DOUBLE_INTEGRATOR, 0, room=50.0)
    problem = replace(problem, velocities=frozen([[0.5, -0.5]]))
    found = objective.terms(problem, np.tile([0.5, -0.5], (1, 3, 1)))
    # 0.75, 1.0 and 1.25 m/s on both axes, 0.6 allowed; the first step's is the box's business.
    assert found.field == pytest.approx(problem.field_weight * 2.0 * (0.4**2 + 0.65**2))
