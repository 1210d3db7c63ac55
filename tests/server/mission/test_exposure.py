"""Prices of exposure as the mission core sets them."""

from dataclasses import replace

import numpy as np
import pytest

from server.mission.core import MissionCore
from server.mission.downlink import Briefing
from server.mission.exposure import PriceList
from server.mission.setup import MissionSetup
from solver.directives import Pairing, Proposal, Source, Weights
from solver.exposure import FREE, RIMS, sight_loss
from solver.observations import Attack
from solver.zones import Zone, ZoneKind
from tests.server.builders import mission_setup, sensing_zone, straight_solution

JAMMER = Zone("c1", ZoneKind.COMMUNICATION, (3.0, 0.0), ((0.4, 0.0), (0.0, 0.4)), 0.2, 0.1)


def priced_setup(sensing_s: float = 1.0, communication_s: float = 1.5) -> MissionSetup:
    setup = mission_setup()
    return replace(
        setup,
        planner=replace(
            setup.planner,
            sensing_failure_s=sensing_s,
            communication_failure_s=communication_s,
            attack_period_s=0.25,
        ),
    )


def test_a_hit_costs_the_trace_lost_per_robot_in_units_of_the_weights() -> None:
    setup = priced_setup()
    prices = PriceList(setup).of(setup.assignment)
    for price, failure_s in ((prices.sensing, 1.0), (prices.communication, 1.5)):
        lost = sight_loss(1, setup.filter, setup.sensor, setup.tick_s, failure_s)
        assert price == pytest.approx(10.0 / 50.0 * lost / 0.25)


def test_targets_watched_twice_make_robots_bolder_and_more_targets_change_nothing() -> None:
    setup = priced_setup()
    one_each = PriceList(setup).of(setup.assignment).sensing
    both = frozenset(Pairing(i, j) for i in (21, 22) for j in (121, 122))
    one_for_both = frozenset(Pairing(21, j) for j in (121, 122))
    twice = 2.0 * sight_loss(2, setup.filter, setup.sensor, setup.tick_s, 1.0) / 5.0 / 0.25
    assert PriceList(setup).of(both).sensing == pytest.approx(twice)
    assert twice < 0.5 * one_each
    assert PriceList(setup).of(one_for_both).sensing == pytest.approx(one_each)
    assert PriceList(setup).of(frozenset()) == FREE


def test_a_kind_that_does_not_matter_has_no_price() -> None:
    setup = replace(priced_setup(communication_s=0.0), weights=Weights(10.0, 0.05, 0.0, 50.0))
    assert PriceList(setup).of(setup.assignment) == FREE
    assert MissionCore(mission_setup()).prices == FREE


def test_priced_zones_reach_the_problem_and_the_robots() -> None:
    core = MissionCore(priced_setup())
    for zone in (sensing_zone(), JAMMER):
        core.observe(Attack(21, zone.kind, zone, 0.0))
    problem = core.begin(0.0)
    rows = 1 + len(RIMS)
    assert problem.sensing.known.tolist() == [[True] * rows] * 2
    assert problem.sensing.quantiles[0] == pytest.approx(sensing_zone().quantile())
    assert problem.communication.known.tolist() == [[True] * rows] * 2
    assert problem.communication.quantiles[0] == 0.0, "its rim is the disc of certain jamming"
    assert problem.communication.margins.tolist() == [0.2] + [0.0] * len(RIMS)
    core.commit(straight_solution(problem))
    assert Briefing(core).of(22).prices == core.prices != FREE


def test_a_new_assignment_has_its_own_prices() -> None:
    core = MissionCore(priced_setup())
    core.commit(straight_solution(core.begin(0.0)))
    before = core.prices
    both = ((21, (121, 122)), (22, (121, 122)))
    proposal = Proposal(id="p", source=Source.TASK_LLM, asked_s=0.0, assignment=both)
    assert core.propose(proposal).accepted
    assert core.prices.sensing < before.sensing
    core.commit(straight_solution(core.begin(0.1)))
    assert np.isfinite(core.prices.communication)
