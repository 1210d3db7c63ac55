"""The reference engines against each other, the reduced objective, and the ways they can end."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import engines, objective
from solver.arrays import frozen, frozen_bool
from solver.bounds import control_box
from solver.directives import Weights
from solver.engines import EngineUnavailable
from solver.engines.casadi_model import padded, parameters, reduced, shape_of
from solver.engines.ipopt import IpoptEngine
from solver.engines.recent import Recent
from solver.engines.sqp import SqpEngine
from solver.problem import Budget, Dynamics, EngineFailed, Problem, Rung
from tests.solver.problems import DYNAMICS, coincident, random_controls, random_problem

SQP, IPOPT = SqpEngine(), IpoptEngine()
PATIENT = Budget(iterations=500)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    robots=st.integers(1, 5),
    targets=st.integers(0, 4),
    zones=st.integers(0, 3),
    obstacles=st.integers(0, 3),
    dynamics=st.sampled_from(DYNAMICS),
)
def test_the_symbolic_objective_is_the_numerical_one(
    seed: int, robots: int, targets: int, zones: int, obstacles: int, dynamics: Dynamics
) -> None:
    """Also where numbers were rounded up to powers of two, and its slope likewise."""
    import casadi as ca

    problem = random_problem(seed, robots, targets, zones, 2, dynamics, obstacles)
    shape = shape_of(problem)
    controls, vector, total = reduced(shape)
    evaluate = ca.Function("f", [controls, vector], [total, ca.gradient(total, controls)])
    at = random_controls(seed, problem)
    value, slope = evaluate(padded(at, shape.robots).ravel(), parameters(problem, shape))
    assert float(value) == pytest.approx(objective.cost(problem, at), rel=1e-10)
    shaped = np.asarray(slope).reshape(shape.robots, 2, 2)
    np.testing.assert_allclose(
        shaped[:robots], objective.gradient(problem, at), rtol=1e-8, atol=1e-8
    )
    np.testing.assert_array_equal(shaped[robots:], 0.0)


def easy(seed: int, horizon: int, dynamics: Dynamics) -> Problem:
    return random_problem(seed, 3, 4, 2, horizon, dynamics, obstacles=1, room=5.0)


@pytest.mark.parametrize("dynamics", DYNAMICS)
@pytest.mark.parametrize("horizon", [1, 3])
def test_sqp_reaches_what_ipopt_reaches_on_the_slack_form(horizon: int, dynamics: Dynamics) -> None:
    gaps = []
    for seed in range(12):
        problem = easy(seed, horizon, dynamics)
        found = SQP.solve(problem, PATIENT)
        best = IPOPT.best_of_starts(problem, 3, seed)
        gaps.append((found.objective - best.objective) / best.objective)
        lower, upper = control_box(problem)
        assert (found.controls >= lower).all()
        assert (found.controls <= upper).all()
        assert found.objective == pytest.approx(objective.cost(problem, found.controls), rel=1e-9)
    assert np.median(gaps) < 1e-6
    assert sum(gap > 3e-4 for gap in gaps) <= 1


def test_the_optimum_is_stationary_and_no_random_plan_is_better() -> None:
    rng = np.random.default_rng(0)
    for seed in range(5):
        problem = easy(seed, 2, Dynamics.SINGLE_INTEGRATOR)
        found = SQP.solve(problem, PATIENT)
        assert found.rung is Rung.CONVERGED
        lower, upper = control_box(problem)
        slope = objective.gradient(problem, found.controls)
        step = np.clip(found.controls - 1e-3 * slope, lower, upper) - found.controls
        assert float(np.abs(slope * step).sum()) < 1e-3
        for scale in (0.01, 0.1):
            near = found.controls + rng.normal(size=lower.shape) * scale
            trial = objective.cost(problem, np.clip(near, lower, upper))
            assert trial >= found.objective * (1.0 - 1e-6)


@pytest.mark.parametrize("engine", [SQP, IPOPT], ids=["sqp", "ipopt"])
def test_same_problem_same_answer_to_the_last_bit(engine: SqpEngine | IpoptEngine) -> None:
    problem = easy(4, 2, Dynamics.SINGLE_INTEGRATOR)
    first = engine.solve(problem, Budget(iterations=100))
    engine.solve(easy(5, 2, Dynamics.SINGLE_INTEGRATOR), Budget(iterations=100))
    again = type(engine)().solve(problem, Budget(iterations=100))
    np.testing.assert_array_equal(first.controls, again.controls)
    assert first.iterations == again.iterations


def test_a_robot_on_the_centre_of_a_zone_with_its_target_there_leaves() -> None:
    for seed in range(6):
        problem = coincident(random_problem(seed, 1, 1, 1, obstacles=0))
        table = replace(problem.sensing, known=frozen_bool([[True]]))
        problem = replace(problem, sensing=table)
        start = float(np.linalg.norm(problem.positions[0] - table.centres[0]))
        for _ in range(8):
            found = SQP.solve(problem, PATIENT)
            problem = replace(problem, positions=frozen(found.positions[:, 0]))
        assert np.linalg.norm(problem.positions[0] - table.centres[0]) > start + 0.3


def test_few_iterations_give_a_feasible_answer_no_worse_than_the_start() -> None:
    for seed in range(5):
        problem = replace(easy(seed, 5, Dynamics.DOUBLE_INTEGRATOR))
        found = SQP.solve(problem, Budget(iterations=2))
        lower, upper = control_box(problem)
        assert found.rung is Rung.FEASIBLE
        assert (found.controls >= lower).all()
        assert (found.controls <= upper).all()
        assert found.objective <= objective.cost(problem, np.clip(0.0 * lower, lower, upper))


def test_the_deadline_stops_the_iterations() -> None:
    problem = random_problem(1, 4, 8, 4, 5, Dynamics.DOUBLE_INTEGRATOR, room=4.0)
    patient = SQP.solve(problem, Budget(iterations=200, deadline_s=60.0))
    hasty = SQP.solve(problem, Budget(iterations=200, deadline_s=0.0))
    assert patient.iterations > 20
    assert hasty.iterations <= 2
    assert hasty.rung is Rung.FEASIBLE
    assert hasty.objective >= patient.objective


def test_weights_zones_and_assignments_are_data() -> None:
    """One engine, one shape, different data: answers differ accordingly."""
    engine = SqpEngine()
    problem = random_problem(7, 3, 4, 0, obstacles=0, room=6.0)
    lazy = engine.solve(replace(problem, weights=Weights(0.1, 500.0, 50.0, 50.0)), PATIENT)
    eager = engine.solve(replace(problem, weights=Weights(100.0, 0.001, 50.0, 50.0)), PATIENT)
    assert np.abs(lazy.controls).max() < 0.1 < 0.4 < np.abs(eager.controls).max()
    blind = replace(problem, sees=frozen_bool(np.zeros_like(problem.sees)))
    np.testing.assert_allclose(engine.solve(blind, PATIENT).controls, 0.0, atol=1e-6)


@pytest.mark.parametrize("engine", [SQP, IPOPT], ids=["sqp", "ipopt"])
def test_numbers_that_are_none_end_in_engine_failed(engine: SqpEngine | IpoptEngine) -> None:
    problem = easy(0, 1, Dynamics.SINGLE_INTEGRATOR)
    broken = replace(problem, positions=frozen(np.full((3, 2), np.nan)))
    with pytest.raises(EngineFailed):
        engine.solve(broken, PATIENT)


def test_engines_come_by_name() -> None:
    assert engines.create("sqp").name == "sqp"
    assert engines.create("ipopt").name == "ipopt"
    assert engines.default_engine() in engines.names()
    with pytest.raises(EngineUnavailable, match="choose one of fast, sqp, ipopt"):
        engines.create("magic")


def test_the_cache_keeps_the_most_recent() -> None:
    kept: Recent[int, str] = Recent(2)
    built = []

    def build(key: int) -> Callable[[], str]:
        def built_now() -> str:
            built.append(key)
            return str(key)

        return built_now

    for key in (1, 2, 1, 3, 1, 2):
        assert kept.get(key, build(key)) == str(key)
    assert built == [1, 2, 3, 2]
    assert len(kept) == 2


def test_an_engine_without_its_libraries_is_unavailable_and_says_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing(module: str) -> None:
        raise ImportError(f"no library for {module}")

    monkeypatch.setattr(engines, "import_module", missing)
    for name, module in (("fast", "fast"), ("sqp", "sqp")):
        told = f"engine '{name}' cannot run here: no library for solver.engines.{module}"
        with pytest.raises(EngineUnavailable, match=told):
            engines.create(name)
    with pytest.raises(EngineUnavailable, match="neither numba nor casadi is installed"):
        engines.default_engine()


def test_the_first_engine_that_can_run_is_the_one_to_use(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_numba(module: str) -> SimpleNamespace:
        if module.endswith("fast"):
            raise ImportError(module)
        return SimpleNamespace(SqpEngine=SqpEngine, IpoptEngine=IpoptEngine)

    monkeypatch.setattr(engines, "import_module", without_numba)
    assert engines.default_engine() == "sqp"


@pytest.mark.parametrize(
    ("name", "loaded"),
    [
        ("sqp", ["sqp.SqpEngine"]),
        ("fast", ["fast.FastEngine", "fast.compiled.compiled"]),
        (engines.DEFAULT, None),
    ],
)
def test_preloading_loads_machine_code_where_there_is_any(
    name: str, loaded: list[str] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []

    class Library:
        """Takes note of what of it is called."""

        def __init__(self, module: str) -> None:
            self._module = module.removeprefix("solver.engines.")

        def __getattr__(self, attribute: str) -> Callable[[], None]:
            return lambda: calls.append(f"{self._module}.{attribute}")

    monkeypatch.setattr(engines, "import_module", Library)
    engines.preload(name)
    if loaded is None:
        assert calls[-2:] == ["fast.FastEngine", "fast.compiled.compiled"]
    else:
        assert calls == loaded
    with pytest.raises(EngineUnavailable, match="magic"):
        engines.preload("magic")
