"""Flights ahead, compared with an independent reckoning of the same path."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from server.gate.comparing import comparison_of
from server.gate.rollout import Comparison, expected_hits, forecast, rolled, travel_s
from server.mission.core import MissionCore
from server.mission.setup import MissionSetup
from solver import engines
from solver.directives import Pairing, Weights
from solver.observations import Link, LinkChange, ZoneDrawn
from solver.planner import Planner
from solver.problem import Budget, Problem, Solution
from solver.zones import Zone, ZoneKind
from tests.server.builders import (
    mission_setup,
    robot_state,
    sensing_zone,
    straight_solution,
)

NO_DRIFT = np.zeros((2, 2))


class Straight(Planner):
    """Flies every robot east at 0.5 m/s, whatever is asked."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def solve(self, problem: Problem, budget: Budget) -> Solution:
        self.problems.append(problem)
        return straight_solution(problem)


@pytest.fixture(scope="module")
def planner() -> Planner:
    """The optimizer that needs no compilation."""
    return Planner(engines.create("sqp"))


def flying(setup: MissionSetup | None = None, *facts: object) -> MissionCore:
    setup = setup or mission_setup(tick_s=0.5)
    core = MissionCore(setup)
    for robot in setup.robots:
        core.observe(robot_state(robot.id, robot.position))
    for fact in facts:
        core.observe(fact)  # type: ignore[arg-type]
    core.commit(straight_solution(core.begin(0.0)))
    return core


def asked(core: MissionCore, drift: np.ndarray = NO_DRIFT, **changes: object) -> Comparison:
    after = replace(core.directives, **changes)  # type: ignore[arg-type]
    return comparison_of(core, after, (), drift)


def test_a_merit_is_what_a_filter_and_the_law_of_attacks_say_by_hand() -> None:
    zone = sensing_zone("s1", (0.0, 0.2))
    core = flying(mission_setup(tick_s=0.5), ZoneDrawn(zone))
    drift = np.array([[0.1, 0.0], [0.0, -0.2]])
    comparison = asked(core, drift)
    merit = rolled(comparison.scene, comparison.in_force, 5.0, Straight())
    setup, trace, hits = core.setup, 0.0, 0.0
    density = multivariate_normal(zone.mean, np.asarray(zone.covariance))
    for i in range(2):
        P = core.beliefs.covariances[i][:2, :2]
        target = core.beliefs.means[i][:2]
        robot = np.array(setup.robots[i].position)
        for _ in range(10):
            robot, target = robot + np.array([0.25, 0.0]), target + 0.5 * drift[i]
            p = robot - target
            rho = math.sqrt(p @ p + 0.01)
            H = np.array([-p / rho, np.array([-p[1], p[0]]) / rho**2])
            R = np.eye(2) / (15.0 * math.exp(-0.2 * rho))
            P = P + setup.filter.process_noise * 0.5 * np.eye(2)
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            P = (np.eye(2) - K @ H) @ P
            trace += 0.5 * float(np.trace(P))
            rate = min(1.0, density.pdf(robot)) / setup.planner.attack_period_s
            hits += 0.5 * rate
    assert merit.seconds == 5.0
    assert merit.trace == pytest.approx(trace, rel=1e-9)
    assert merit.sensing_hits == pytest.approx(hits, rel=1e-9)
    assert merit.communication_hits == 0.0
    assert merit.effort == pytest.approx(2 * 5.0 * 0.25)


def test_more_frequent_measurements_tell_more() -> None:
    seldom = asked(flying())
    often = replace(seldom, scene=replace(seldom.scene, tick_s=0.1))
    traces = [rolled(c.scene, c.in_force, 5.0, Straight()).trace for c in (seldom, often)]
    assert traces[1] < traces[0]


def test_a_jamming_disc_grows_with_the_spread_of_the_team() -> None:
    zone = Zone("c1", ZoneKind.COMMUNICATION, (0.0, 1.0), ((1e-3, 0.0), (0.0, 1e-3)), 0.6, 0.1)
    scene = asked(flying(None, ZoneDrawn(zone))).scene
    together = np.array([[[0.0, 0.5], [0.0, 0.6]]])
    apart = np.array([[[0.0, 0.0], [0.0, 2.0]]])
    assert expected_hits(scene, together)[1] == pytest.approx(0.0, abs=1e-9)
    assert expected_hits(scene, apart)[1] == pytest.approx(2 / 0.5)


def test_a_zone_nobody_knows_costs_nothing_and_severity_moves_no_yardstick() -> None:
    known = flying(None, ZoneDrawn(sensing_zone("s1", (-1.0, 0.0))))
    unknown = flying()
    comparison = asked(known, severities=(("s1", 5.0),))
    plain = rolled(comparison.scene, comparison.in_force, 5.0, Straight())
    severe = rolled(comparison.scene, comparison.proposed, 5.0, Straight())
    nothing = asked(unknown)
    assert plain == severe
    assert plain.sensing_hits > 0.0
    assert rolled(nothing.scene, nothing.in_force, 5.0, Straight()).sensing_hits == 0.0


def test_a_blind_robot_sees_again_after_the_usual_time() -> None:
    core = flying()
    core.observe(robot_state(21, (-2.0, 0.0), sensing_failed=True))
    core.commit(straight_solution(core.begin(0.5)))
    comparison = asked(core)
    watched = Straight()
    rolled(comparison.scene, comparison.in_force, 5.0, watched)
    seen = [bool(problem.sees[0, 0]) for problem in watched.problems]
    # 1.2 s: plans of one step begin at 0, 0.5, 1.0, 1.5, ...
    assert seen == [False, False, False] + [True] * 7


def test_a_jammed_robot_is_not_flown_and_tells_again_later() -> None:
    core = flying()
    core.observe(LinkChange(21, Link.JAMMED, "silent"))
    core.commit(straight_solution(core.begin(0.5)))
    comparison = asked(core)
    assert comparison.in_force.problem.robot_ids == (22,)
    assert comparison.in_force.absent.tolist() == [[True, False]]
    short = rolled(comparison.scene, comparison.in_force, 1.5, Straight())
    long = rolled(comparison.scene, comparison.in_force, 10.0, Straight())
    assert long.trace / long.seconds < 2.0 * short.trace / short.seconds


def test_weights_that_chase_targets_through_a_known_zone_are_predicted_worse(
    planner: Planner,
) -> None:
    core = flying(
        replace(mission_setup(tick_s=0.5), weight_lower=Weights(1e-6, 1e-6, 1e-6, 1e-6)),
        ZoneDrawn(sensing_zone("s1", (0.0, 0.0))),
        ZoneDrawn(sensing_zone("s2", (0.0, 2.0))),
    )
    comparison = asked(core, weights=Weights(10.0, 0.05, 1e-6, 50.0))
    made = forecast(comparison, planner)
    assert made.horizon_s == 5.0
    assert made.proposed.sensing_hits > made.in_force.sensing_hits


def test_the_same_question_has_the_same_answer(planner: Planner) -> None:
    core = flying(None, ZoneDrawn(sensing_zone("s1", (0.0, 0.3))))
    comparison = asked(core, weights=Weights(50.0, 0.05, 10.0, 50.0))
    first = forecast(comparison, planner)
    again = forecast(comparison, planner)
    assert first == again


def test_assignments_are_watched_for_as_long_as_the_way_takes() -> None:
    core = flying()
    snapshot = core.snapshot
    assert travel_s(snapshot, {(21, 121)}, 1.0) == 5.0
    assert travel_s(snapshot, {(21, 121)}, 0.4) == 10.0
    assert travel_s(snapshot, {(21, 121)}, 0.01) == 30.0
    swapped = frozenset({Pairing(21, 122), Pairing(22, 121)})
    assert asked(core, assignment=swapped).horizon_s == 5.0
    assert asked(core).in_force.assigned.tolist() == [[True, False], [False, True]]
    assert asked(core, assignment=swapped).proposed.assigned.tolist() == [
        [False, True],
        [True, False],
    ]
