"""The yardstick: by hand, independent of what proposals may change."""

from dataclasses import replace

import pytest

from server.gate.merit import Merit, MeritPrices
from server.mission.setup import MeritSetup
from tests.server.builders import mission_setup

PRICES = MeritPrices(sensing=2.0, communication=3.0, effort=0.5)


def test_a_merit_is_the_mean_trace_with_hits_and_effort_at_their_prices() -> None:
    merit = Merit(seconds=4.0, trace=8.0, sensing_hits=0.5, communication_hits=2.0, effort=6.0)
    assert merit.per_second(PRICES) == pytest.approx((8.0 + 1.0 + 6.0 + 3.0) / 4.0)
    assert Merit(0.0, 1.0, 1.0, 1.0, 1.0).per_second(PRICES) == 0.0


def test_a_hit_costs_the_trace_that_builds_up_while_the_robot_is_out() -> None:
    setup = mission_setup(robots=2, targets=4, tick_s=0.5)
    setup = replace(setup, planner=replace(setup.planner, sensing_failure_s=1.0))
    # By hand: random walk q per second, one sighting a tick from 1 m, both axes alike.
    told = 15.0 * 2.718281828459045**-0.2
    variance = setup.filter.prior_variance
    for _ in range(2000):
        variance = 1.0 / (1.0 / (variance + setup.filter.process_noise * 0.5) + told)
    grown = [setup.filter.process_noise * 0.5 * ticks for ticks in (1, 2)]
    loss = sum(2.0 * 0.5 * growth for growth in grown)
    assert MeritPrices.of(setup).sensing == pytest.approx(2.0 * loss, rel=1e-6)
    assert variance < 0.1


def test_prices_do_not_depend_on_weights_assignments_or_severities() -> None:
    setup = mission_setup()
    other = replace(setup, weights=setup.weight_upper, assignment=frozenset())
    assert MeritPrices.of(setup) == MeritPrices.of(other)


def test_a_scenario_may_name_the_prices() -> None:
    merit = MeritSetup(sensing_price=7.0, communication_price=0.0, effort_price=0.25)
    assert MeritPrices.of(replace(mission_setup(), merit=merit)) == MeritPrices(7.0, 0.0, 0.25)
