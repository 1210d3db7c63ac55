"""The gate's predictions in a thread of their own: no tick and no request waits for them long."""

import asyncio
import time
from typing import Protocol, Self

import structlog

from server.gate.rollout import Comparison, Forecast, forecast
from server.live.threads import WorkThread
from solver.planner import Planner

log = structlog.get_logger(__name__)


class Forecaster(Protocol):
    """Predicts what a proposal would do."""

    spent_s: list[float]
    """Thread time of each forecast."""

    async def predict(self, comparison: Comparison, patience_s: float) -> Forecast | None:
        """Return the forecast, None when it is not there after `patience_s`. Never raises."""
        ...


class ForecastThread:
    """Makes one forecast after another, beside the event loop. Use it as a context.

    The planner is the gate's own. Forecasts behind one that hangs are given up by who waits for
    them.
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._thread = WorkThread("gate")
        self.spent_s: list[float] = []

    def __enter__(self) -> Self:
        self._thread.__enter__()
        return self

    def __exit__(self, *exception: object) -> None:
        self._thread.__exit__(*exception)

    async def predict(self, comparison: Comparison, patience_s: float) -> Forecast | None:
        """Return the forecast, None when it is not there after `patience_s`. Never raises."""
        answer: asyncio.Future[Forecast | None] = asyncio.get_running_loop().create_future()

        def deliver(made: tuple[Forecast | None, float] | None) -> None:
            if made is None:
                return
            self.spent_s.append(made[1])
            if not answer.done():
                answer.set_result(made[0])

        def work() -> tuple[Forecast | None, float] | None:
            if answer.done():
                return None  # nobody waits for it any more
            began_s = time.thread_time()
            made = self._made(comparison)
            return made, time.thread_time() - began_s

        self._thread.submit(work, deliver)
        try:
            async with asyncio.timeout(patience_s):
                return await answer
        except TimeoutError:
            log.warning("a prediction took too long", patience_s=patience_s)
            return None

    def _made(self, comparison: Comparison) -> Forecast | None:
        try:
            return forecast(comparison, self._planner)
        except Exception:  # a fault of the prediction must not end the gate
            log.exception("a prediction failed")
            return None
