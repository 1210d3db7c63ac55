from itertools import combinations
from math import dist

import pytest

from server.experiments.generation import LEAST_DIST_M, Layout, generated
from solver.zones import ZoneKind


@pytest.mark.parametrize("robots", [2, 4, 17, 64])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_scenario_has_the_size_and_holds_its_own_rules(robots: int, seed: int) -> None:
    scenario = generated(Layout(robots, 2 * robots, zones=6), seed)
    kinds = [zone.kind for zone in scenario.zones]
    assert (len(scenario.robots), len(scenario.targets)) == (robots, 2 * robots)
    assert (kinds.count(ZoneKind.SENSING), kinds.count(ZoneKind.COMMUNICATION)) == (3, 3)
    assert {t for row in scenario.assignment.values() for t in row} == set(range(2 * robots))
    assert all(1 <= len(row) <= 3 for row in scenario.assignment.values())
    for one, other in combinations(scenario.robots, 2):
        assert dist(one.position, other.position) >= LEAST_DIST_M


def test_a_seed_gives_one_scenario_and_another_seed_another() -> None:
    layout = Layout(4, 8, zones=4)
    assert generated(layout, 3) == generated(layout, 3)
    assert generated(layout, 3).robots != generated(layout, 4).robots


def test_the_density_stays_the_same() -> None:
    def area(robots: int) -> float:
        field = generated(Layout(robots, robots, zones=2), 0).field
        return (field.upper[0] - field.lower[0]) * (field.upper[1] - field.lower[1])

    assert area(40) == pytest.approx(10 * area(4))


def test_more_targets_than_capacities_are_refused() -> None:
    with pytest.raises(ValueError, match="more than the team can track"):
        generated(Layout(2, 7, zones=0), 0)
