"""The fast engine as a whole: right answers, whenever and however it is stopped."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.adversarial import adversarial_problem, faults, trial
from benchmarks.missions import Layout, ticks
from solver import engines, objective
from solver.arrays import FloatArray, frozen, frozen_bool
from solver.bounds import control_box, rollout
from solver.directives import Weights
from solver.engines.fast import FastEngine
from solver.engines.ipopt import IpoptEngine
from solver.problem import Budget, Dynamics, EngineFailed, Problem, Rung, Solution
from solver.zones import Zone, ZoneKind
from tests.solver.problems import DYNAMICS, coincident, random_problem, zone_table

FAST, IPOPT = FastEngine(), IpoptEngine()
PATIENT = Budget(iterations=500)

# Where no machine code is in the cache yet, the first test compiles it.
pytestmark = pytest.mark.timeout(900)


def stationarity(problem: Problem, controls: FloatArray) -> float:
    """Return what a small projected gradient step promises, relative to the cost."""
    lower, upper = control_box(problem)
    slope = objective.gradient(problem, controls)
    step = np.clip(controls - 1e-3 * slope, lower, upper) - controls
    return float(-(slope * step).sum()) / (1.0 + objective.cost(problem, controls))


def test_it_is_the_engine_of_that_name() -> None:
    assert isinstance(engines.create("fast"), FastEngine)
    assert engines.default_engine() == FAST.name == "fast"


@pytest.mark.parametrize("dynamics", DYNAMICS)
@pytest.mark.parametrize("horizon", [1, 2, 5, 10])
def test_answers_are_what_they_claim_to_be(horizon: int, dynamics: Dynamics) -> None:
    for seed in range(20):
        problem = random_problem(seed, 5, 8, 2, horizon, dynamics, room=4.0)
        found = FAST.solve(problem, PATIENT)
        assert not faults(problem, found)
        positions, velocities = rollout(problem, found.controls)
        np.testing.assert_allclose(found.positions, positions, atol=1e-12)
        np.testing.assert_allclose(found.velocities, velocities, atol=1e-12)
        assert found.objective == pytest.approx(objective.cost(problem, found.controls), rel=1e-9)
        assert found.engine == "fast"
        assert found.robot_ids == problem.robot_ids


@pytest.mark.parametrize("dynamics", DYNAMICS)
@pytest.mark.parametrize("horizon", [1, 3, 6])
def test_converged_answers_are_stationary(horizon: int, dynamics: Dynamics) -> None:
    worst = []
    for seed in range(20):
        problem = random_problem(seed, 4, 6, 2, horizon, dynamics, room=5.0)
        found = FAST.solve(problem, PATIENT)
        if found.rung is Rung.CONVERGED:
            worst.append(stationarity(problem, found.controls))
    assert len(worst) >= 16
    assert np.median(worst) < 1e-5
    assert max(worst) < 1e-3


@pytest.mark.parametrize("dynamics", DYNAMICS)
@pytest.mark.parametrize("horizon", [1, 3])
def test_no_start_of_ipopt_leads_lower(horizon: int, dynamics: Dynamics) -> None:
    gaps = []
    for seed in range(10):
        problem = random_problem(seed, 3, 4, 2, horizon, dynamics, obstacles=1, room=5.0)
        best = IPOPT.best_of_starts(problem, 8, seed)
        gaps.append(FAST.solve(problem, PATIENT).objective / best.objective - 1.0)
    assert sum(gap > 3e-4 for gap in gaps) <= 1
    assert np.median(gaps) < 1e-6


@pytest.mark.parametrize(
    ("mate", "targets"),
    [
        ((-0.20, -0.64), ((-0.03, -0.67), (0.00, 0.35))),
        ((-0.17, -0.64), ((0.03, -0.66), (0.01, 0.28))),
        ((-0.13, -0.61), ((0.04, -0.60), (0.04, 0.36))),
    ],
)
def test_two_robots_that_stand_in_each_others_way_move_together(
    mate: tuple[float, float], targets: tuple[tuple[float, float], tuple[float, float]]
) -> None:
    """No move of one of them alone leads to where both should be."""
    problem = replace(
        random_problem(0, robots=2, targets=2, zones=0, obstacles=0),
        positions=frozen([(0.0, 0.0), mate]),
        sees=frozen_bool(np.ones((2, 2))),
        target_means=frozen([targets]),
        target_priors=frozen([np.diag((0.068, 0.054)), np.diag((0.058, 0.076))]),
        weights=Weights(5.0, 0.01, 50.0, 50.0),
        min_dist_m=0.6,
    )
    best = objective.exact_cost(problem, IPOPT.best_of_starts(problem, 8).controls)
    found = objective.exact_cost(problem, FAST.solve(problem, PATIENT).controls)
    assert found <= best * (1.0 + 3e-4)


def test_a_robot_goes_to_the_other_side_of_its_target_together_with_its_mates() -> None:
    """Alone it would find that dearer: there it jams the other, unless that one moves as well."""
    jammer = Zone(
        "c0", ZoneKind.COMMUNICATION, (4.24, 4.94), ((0.31, -0.06), (-0.06, 0.79)), 0.107, 0.1
    )
    near, far = ((0.0166, -0.0042), (-0.0042, 0.0167)), ((0.0159, 0.0047), (0.0047, 0.021))
    problem = replace(
        random_problem(0, robots=2, targets=2, zones=0, obstacles=0, room=4.8),
        positions=frozen([(4.9, 3.42), (4.69, -1.27)]),
        sees=frozen_bool(np.ones((2, 2))),
        target_means=frozen([[(4.85, -1.36), (5.0, 3.65)]]),
        target_priors=frozen([near, far]),
        communication=zone_table([jammer], np.ones((2, 1), dtype=np.bool_)),
    )
    best = objective.exact_cost(problem, IPOPT.best_of_starts(problem, 8).controls)
    found = objective.exact_cost(problem, FAST.solve(problem, PATIENT).controls)
    assert found <= best * (1.0 + 3e-4)


@pytest.mark.parametrize(("horizon", "most"), [(1, 100), (5, 250)])
def test_contact_takes_few_steps(horizon: int, most: int) -> None:
    """Two robots want to be where one of them can be; each step would run into the other."""
    steps = []
    for seed in range(30):
        problem = random_problem(seed, 2, 1, 0, horizon, room=6.0)
        apart = np.array([[-problem.min_dist_m, 0.05], [problem.min_dist_m, -0.03]])
        beside = frozen(problem.target_means[0, 0] + apart)
        both = frozen_bool(np.ones((2, 1)))
        found = FAST.solve(replace(problem, positions=beside, sees=both, previous=None), PATIENT)
        assert found.rung is Rung.CONVERGED
        steps.append(found.iterations)
    assert np.median(steps) < most


def test_the_rim_of_a_zone_takes_few_steps() -> None:
    """A target in the middle of a zone draws a robot towards it; steps would go too deep."""
    steps = []
    for seed in range(8):
        problem = random_problem(seed, 1, 1, 0, 1, obstacles=0, room=6.0)
        target = problem.target_means[0, 0]
        zone = Zone(
            "s0", ZoneKind.SENSING, tuple(target.tolist()), ((0.3, 0.1), (0.1, 0.2)), 0.2, 0.1
        )
        seen = replace(
            problem,
            positions=frozen(target + np.array([[0.95, 0.35 + 0.05 * seed]])),
            sees=frozen_bool(np.ones((1, 1))),
            sensing=zone_table([zone], np.ones((1, 1), dtype=np.bool_)),
            previous=None,
        )
        steps.append(FAST.solve(seen, PATIENT).iterations)
    assert np.median(steps) < 20  # 26 where hinges that are off are not seen coming


def test_warm_started_in_closed_loop_it_stays_with_the_best_of_eight_starts() -> None:
    layout = Layout(robots=2, targets=4, horizon=1, seed=8)
    gaps = []
    for tick, (problem, found) in enumerate(ticks(layout, 60, lambda p: FAST.solve(p, Budget()))):
        if tick % 3 == 0:
            best = IPOPT.best_of_starts(problem, 8)
            exact = objective.exact_cost(problem, best.controls)
            gaps.append(objective.exact_cost(problem, found.controls) / exact - 1.0)
    assert sum(gap > 3e-4 for gap in gaps) <= 1


def test_same_problem_same_answer_to_the_last_bit() -> None:
    for horizon in (1, 4):
        problem = random_problem(4, 6, 9, 3, horizon)
        first = FAST.solve(problem, Budget(iterations=100))
        FAST.solve(random_problem(5, 3, 4, 3, 2), Budget(iterations=7))
        again = FastEngine().solve(problem, Budget(iterations=100))
        np.testing.assert_array_equal(first.controls, again.controls)
        assert (first.iterations, first.objective) == (again.iterations, again.objective)


@pytest.mark.parametrize("horizon", [1, 5])
def test_a_robot_on_the_centre_of_a_zone_with_its_target_there_leaves(horizon: int) -> None:
    for seed in range(6):
        problem = coincident(random_problem(seed, 1, 1, 1, horizon, obstacles=0))
        centre = problem.sensing.centres[0]
        table = replace(problem.sensing, known=frozen_bool([[True]]))
        problem = replace(problem, sensing=table)
        for _ in range(8):
            found = FAST.solve(problem, PATIENT)
            problem = replace(problem, positions=frozen(found.positions[:, 0]))
        assert np.linalg.norm(problem.positions[0] - centre) > 0.3


@pytest.mark.parametrize("horizon", [1, 5])
def test_robots_on_one_spot_part(horizon: int) -> None:
    problem = random_problem(2, 3, 3, 1, horizon, obstacles=0, room=9.0)
    problem = replace(problem, positions=frozen(np.full((3, 2), 1.0)))
    for _ in range(6):
        found = FAST.solve(problem, PATIENT)
        problem = replace(problem, positions=frozen(found.positions[:, 0]))
    gaps = np.linalg.norm(problem.positions[:, None] - problem.positions[None], axis=-1)
    assert gaps[np.triu_indices(3, 1)].min() > 0.3


def test_more_iterations_are_never_worse() -> None:
    for seed in range(8):
        problem = random_problem(seed, 5, 7, 3, 5, DYNAMICS[seed % 2], room=3.0)
        costs = [FAST.solve(problem, Budget(iterations=n)).objective for n in (1, 2, 4, 8, 200)]
        start = objective.cost(problem, np.clip(np.zeros((5, 5, 2)), *control_box(problem)))
        assert costs[0] <= start
        assert costs[-1] <= min(costs) * (1.0 + 1e-3)


def test_without_time_it_answers_with_the_last_plan_moved_into_the_box() -> None:
    problem = random_problem(1, 4, 6, 2, 3)
    plan = np.random.default_rng(0).normal(size=(4, 3, 2))
    problem = replace(problem, previous=frozen(plan))
    found = FAST.solve(problem, Budget(deadline_s=0.0))
    assert found.rung is Rung.FEASIBLE
    assert found.iterations == 0
    np.testing.assert_array_equal(found.controls, np.clip(plan, *control_box(problem)))


def test_the_deadline_holds_in_the_middle_of_a_large_team() -> None:
    problem = random_problem(1, 200, 400, 5, 10, room=40.0)
    patient = FAST.solve(problem, Budget())
    stopped = 0
    for _ in range(20):
        hasty = FAST.solve(problem, Budget(deadline_s=0.2 * patient.solve_s))
        assert hasty.iterations < patient.iterations, "stopped by the clock"
        assert hasty.rung is Rung.FEASIBLE
        assert not faults(problem, hasty)
        assert patient.objective < hasty.objective
        stopped = hasty.iterations
        if stopped > 0:  # else others had the processor until then
            break
    assert stopped > 0, "in the middle"


def test_a_horizon_without_room_is_refused() -> None:
    with pytest.raises(EngineFailed, match="horizon 11"):
        FAST.solve(random_problem(0, horizon=11), Budget())


def test_an_objective_that_is_no_number_is_refused() -> None:
    problem = random_problem(0)
    broken = replace(problem, target_means=frozen(np.full((1, 5, 2), np.nan)))
    with pytest.raises(EngineFailed, match="objective"):
        FAST.solve(broken, Budget())


def test_arrays_of_another_kind_or_order_are_converted() -> None:
    """Machine code is called without a look at types: a stranger would be read as numbers."""
    problem = random_problem(3, 3, 4, 2, room=6.0)
    sound = replace(problem, positions=frozen(np.round(problem.positions)))
    strange = replace(
        sound,
        positions=sound.positions.astype(np.int32),
        target_priors=np.asfortranarray(sound.target_priors),
        control_lower=np.repeat(sound.control_lower, 2, axis=0)[::2],
        sees=sound.sees.astype(np.int8),
        replan=sound.replan.astype(np.float64),
    )
    found, expected = FAST.solve(strange, PATIENT), FAST.solve(sound, PATIENT)
    np.testing.assert_array_equal(found.controls, expected.controls)


def test_replanned_robots_forget_their_plan() -> None:
    """A plan into the wrong direction, and the free way is found again when asked for."""
    problem = random_problem(6, 1, 1, 0, 1, obstacles=0, room=5.0)
    ahead = problem.target_means[0, 0] - problem.positions[0]
    wrong = frozen(-np.sign(ahead)[None, None] * 0.5)
    found = FAST.solve(replace(problem, previous=wrong, replan=frozen_bool([True])), Budget())
    assert float(found.controls[0, 0] @ ahead) > 0.0


def test_weights_zones_and_assignments_are_data() -> None:
    problem = random_problem(7, 3, 4, 0, obstacles=0, room=6.0)
    lazy = FAST.solve(replace(problem, weights=Weights(0.1, 500.0, 50.0, 50.0)), PATIENT)
    eager = FAST.solve(replace(problem, weights=Weights(100.0, 0.001, 50.0, 50.0)), PATIENT)
    assert np.abs(lazy.controls).max() < 0.1 < 0.4 < np.abs(eager.controls).max()
    blind = replace(problem, sees=frozen_bool(np.zeros_like(problem.sees)))
    np.testing.assert_allclose(FAST.solve(blind, PATIENT).controls, 0.0, atol=1e-6)


@pytest.mark.parametrize("block", range(4))
def test_nothing_breaks_it(block: int) -> None:
    """The long version is `python -m benchmarks.adversarial`."""
    for seed in range(750 * block, 750 * (block + 1)):
        problem = adversarial_problem(seed)
        found: Solution = FAST.solve(problem, Budget())
        assert not faults(problem, found), seed


def test_hasty_solves_are_sound_and_in_time() -> None:
    """Each problem to the end and against a deadline, as the long version does."""
    tally = trial(FAST, 150, seed=5000)
    assert tally.solved == 150
    assert (tally.faulty, tally.late) == (0, 0)


def test_a_large_team_converges_in_closed_loop() -> None:
    layout = Layout(robots=48, targets=96, horizon=5, seed=2)
    rungs = []
    for problem, found in ticks(layout, 12, lambda p: FAST.solve(p, Budget())):
        assert not faults(problem, found)
        rungs.append(found.rung)
    assert rungs.count(Rung.CONVERGED) >= 9
