from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from server.gate.decisions import Changes, Judgement
from server.gate.judging import Judge
from server.gate.merit import Merit, MeritPrices
from server.gate.rollout import Forecast
from server.mission.setup import GateMode
from solver.directives import Source

PRICES = MeritPrices(sensing=2.0, communication=3.0, effort=0.5)
CHANGES = Changes(weights=(("tracking", 1.0, 2.0),))


def forecast(before: float, after: float) -> Forecast:
    """Mean traces of 10 s, nothing else."""
    sides = (Merit(10.0, 10.0 * trace, 0.0, 0.0, 0.0) for trace in (before, after))
    return Forecast(10.0, *sides)


def judge() -> Judge:
    return Judge(GateMode.AUTO, PRICES, share=0.1)


def test_merit_is_a_mean_trace_with_prices() -> None:
    merit = Merit(seconds=4.0, trace=8.0, sensing_hits=1.5, communication_hits=0.5, effort=2.0)
    assert merit.per_second(PRICES) == pytest.approx((8.0 + 3.0 + 1.5 + 1.0) / 4.0)
    assert Merit(0.0, 1.0, 1.0, 1.0, 1.0).per_second(PRICES) == 0.0


@pytest.mark.parametrize(
    ("after", "judgement"),
    [
        (0.9, Judgement.BETTER),
        (1.0, Judgement.BETTER),
        (1.05, Judgement.NOT_WORSE),
        (1.11, Judgement.CLEARLY_WORSE),
    ],
)
def test_worse_by_more_than_the_margin_is_clearly_worse(after: float, judgement: Judgement) -> None:
    verdict = judge().rule(CHANGES, forecast(1.0, after))
    assert verdict.judgement is judgement
    assert verdict.difference == pytest.approx(after - 1.0)
    assert verdict.margin == pytest.approx(0.1)


def test_small_losses_add_up_until_they_are_made_good() -> None:
    gate = judge()
    small = forecast(1.0, 1.06)
    first = gate.rule(CHANGES, small)
    assert first.judgement is Judgement.NOT_WORSE
    gate.adopted(Source.ACTION_LLM, first)
    assert gate.rule(CHANGES, small).judgement is Judgement.CLEARLY_WORSE
    gate.adopted(Source.ACTION_LLM, gate.rule(CHANGES, forecast(1.0, 0.95)))
    assert gate.rule(CHANGES, small).judgement is Judgement.NOT_WORSE


def test_a_person_ends_the_debt() -> None:
    gate = judge()
    small = forecast(1.0, 1.06)
    gate.adopted(Source.TASK_LLM, gate.rule(CHANGES, small))
    gate.adopted(Source.OPERATOR, gate.rule(CHANGES, forecast(1.0, 2.0)))
    assert gate.rule(CHANGES, small).judgement is Judgement.NOT_WORSE


def test_nothing_asked_and_nothing_predicted_are_told_apart() -> None:
    assert judge().rule(Changes(), None).judgement is Judgement.UNCHANGED
    assert judge().rule(CHANGES, None).judgement is Judgement.UNJUDGED


def test_expected_hits_follow_the_law_of_attacks() -> None:
    from server.gate.rollout import expected_hits
    from tests.server.gate.scenes import scene

    world = scene()
    paths = np.array([[[0.3, 0.1], [3.0, 3.0]], [[0.0, 0.0], [0.5, 0.5]]])
    found = expected_hits(world, paths)
    period_s = world.setup.planner.attack_period_s
    zone = world.zones[0]
    density = multivariate_normal(zone.mean, zone.covariance)
    known = sum(min(1.0, density.pdf(paths[k, 0])) for k in range(2))  # robot 1 does not know it
    assert found == pytest.approx([known / period_s, 0.0])
    doubted = replace(world, likely=np.array([0.25]))
    assert expected_hits(doubted, paths) == pytest.approx([0.25 * known / period_s, 0.0])
