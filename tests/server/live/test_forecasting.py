"""The gate's predictions: in time, or given up."""

import threading

import numpy as np
import pytest

from server.gate.comparing import comparison_of
from server.gate.merit import Merit
from server.gate.rollout import Comparison, Forecast
from server.live import forecasting
from server.live.forecasting import ForecastThread
from server.mission.core import MissionCore
from solver import engines
from solver.planner import Planner
from tests.patience import PATIENCE_S
from tests.server.builders import mission_setup, straight_solution

MERIT = Merit(5.0, 1.0, 0.0, 0.0, 0.0)
FORECAST = Forecast(5.0, MERIT, MERIT)


def comparison() -> Comparison:
    core = MissionCore(mission_setup())
    core.commit(straight_solution(core.begin(0.0)))
    return comparison_of(core, core.directives, (), np.zeros((2, 2)))


@pytest.mark.asyncio
async def test_a_forecast_is_made_in_a_thread_and_its_time_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made_in: list[str] = []

    def made(asked: Comparison, planner: Planner) -> Forecast:
        made_in.append(threading.current_thread().name)
        return FORECAST

    monkeypatch.setattr(forecasting, "forecast", made)
    with ForecastThread(Planner(engines.create("sqp"))) as thread:
        assert await thread.predict(comparison(), PATIENCE_S) is FORECAST
    assert made_in == ["gate"]
    assert len(thread.spent_s) == 1


@pytest.mark.asyncio
async def test_who_waits_for_a_forecast_that_hangs_gives_up_and_so_do_those_behind(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gate, asked = threading.Event(), []

    def slow(what: Comparison, planner: Planner) -> Forecast:
        asked.append(what)
        gate.wait(PATIENCE_S)
        return FORECAST

    monkeypatch.setattr(forecasting, "forecast", slow)
    with ForecastThread(Planner(engines.create("sqp"))) as thread:
        first, second, third = comparison(), comparison(), comparison()
        while not asked:  # given up before the thread was awake, it is not begun
            assert await thread.predict(first, 0.02) is None
        assert await thread.predict(second, 0.02) is None
        gate.set()
        assert await thread.predict(third, PATIENCE_S) is FORECAST
    assert asked == [first, third], "nobody waits for the second any more"


@pytest.mark.asyncio
async def test_a_forecast_that_fails_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(what: Comparison, planner: Planner) -> Forecast:
        raise FloatingPointError("no merit")

    monkeypatch.setattr(forecasting, "forecast", broken)
    with ForecastThread(Planner(engines.create("sqp"))) as thread:
        assert await thread.predict(comparison(), PATIENCE_S) is None
