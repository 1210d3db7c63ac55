"""Who is probed, and where to."""

from dataclasses import replace

import numpy as np
import pytest

from solver.arrays import FloatArray, frozen, frozen_bool
from solver.engines.probes import probe_start, stuck
from solver.problem import Problem
from solver.zones import Zone, ZoneKind
from tests.solver.problems import random_problem, zone_table

DIAGONAL = np.sqrt(0.5)


def in_zone(offset: tuple[float, float], known: bool, kind: str) -> Problem:
    """Return a problem whose second robot stands at an offset from a long zone's centre."""
    zone = Zone("s1", ZoneKind(kind), (1.0, 2.0), ((4.0, 0.0), (0.0, 1.0)), 5.0, 0.1)
    problem = random_problem(0, 2, 1, 0, obstacles=0)
    table = replace(zone_table([zone], np.array([[True], [known]])), quantiles=frozen([1.5]))
    if kind == "sensing":
        problem = replace(problem, sensing=table)
    else:
        problem = replace(problem, communication=table)
    return replace(problem, positions=frozen([[50.0, 0.0], [1.0 + offset[0], 2.0 + offset[1]]]))


@pytest.mark.parametrize("kind", ["sensing", "communication"])
@pytest.mark.parametrize(
    ("offset", "inside"),
    [
        ((0.0, 0.0), True),
        ((2.99, 0.0), True),
        ((-3.01, 0.0), False),
        ((0.0, 1.49), True),
        ((0.0, -1.51), False),
    ],
)
def test_who_is_inside_the_rim_of_a_zone_it_knows_is_stuck(
    offset: tuple[float, float], inside: bool, kind: str
) -> None:
    assert stuck(in_zone(offset, known=True, kind=kind)).tolist() == [1] * inside
    assert stuck(in_zone(offset, known=False, kind=kind)).tolist() == []


def test_who_is_asked_for_by_name_is_probed_wherever_it_is() -> None:
    problem = in_zone((0.0, 0.0), known=True, kind="sensing")
    assert stuck(replace(problem, replan=frozen_bool([True, False]))).tolist() == [0, 1]
    far = in_zone((50.0, 0.0), known=True, kind="sensing")
    assert stuck(replace(far, replan=frozen_bool([True, False]))).tolist() == [0]
    assert not far.replan.any(), "the problem is as it was"


class Costs:
    """The cost of plans is how far one robot's last control is from a goal."""

    def __init__(self, goal: FloatArray, row: int) -> None:
        self.goal, self.row = goal, row

    def __call__(self, plans: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm(plans[:, self.row, -1] - self.goal, axis=1))


@pytest.mark.parametrize("turn", range(8))
def test_the_best_of_eight_directions_is_taken_as_far_as_the_box_allows(turn: int) -> None:
    plan = np.full((2, 3, 2), 0.1)
    lower, upper = np.full((2, 3, 2), -2.0), np.full((2, 3, 2), 2.0)
    angle = turn * np.pi / 4.0
    goal = 2.0 * np.array([np.cos(angle), np.sin(angle)])
    found = probe_start(plan, lower, upper, np.array([1]), Costs(goal, 1))
    np.testing.assert_allclose(found[1], np.tile(goal, (3, 1)), atol=1e-12)
    np.testing.assert_array_equal(found[0], 0.1)
    np.testing.assert_array_equal(plan, 0.1)


def test_directions_are_cut_at_the_box() -> None:
    plan = np.zeros((1, 1, 2))
    lower, upper = np.array([[[-0.2, -3.0]]]), np.array([[[1.0, 0.5]]])
    found = probe_start(plan, lower, upper, np.array([0]), Costs(np.array([-9.0, -2.0]), 0))
    np.testing.assert_allclose(found[0, 0], [-0.2, -3.0 * DIAGONAL])


def test_one_robot_knows_where_the_one_before_it_has_gone() -> None:
    def apart(plans: FloatArray) -> FloatArray:
        """Both want to go east, and not both."""
        east = plans[:, :, 0, 0]
        together = np.linalg.norm(plans[:, 0, 0] - plans[:, 1, 0], axis=1) < 0.1
        return np.asarray(-east.sum(axis=1) + 10.0 * together)

    box = np.ones((2, 1, 2))
    found = probe_start(np.zeros((2, 1, 2)), -box, box, np.array([0, 1]), apart)
    np.testing.assert_allclose(found[0, 0], [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.abs(found[1, 0]), DIAGONAL)
    assert found[1, 0, 0] > 0.0


def test_costs_that_are_no_numbers_are_passed_over() -> None:
    box = np.ones((1, 1, 2))
    plan = np.full((1, 1, 2), 0.3)

    def west_alone(plans: FloatArray) -> FloatArray:
        return np.where(plans[:, 0, 0, 0] < -0.9, 5.0, np.nan)

    found = probe_start(plan, -box, box, np.array([0]), west_alone)
    np.testing.assert_allclose(found[0, 0], [-1.0, 0.0], atol=1e-12)
    nowhere = probe_start(plan, -box, box, np.array([0]), lambda plans: np.full(len(plans), np.nan))
    np.testing.assert_array_equal(nowhere, plan)
