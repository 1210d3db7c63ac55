"""The gate's predictions in a thread of their own: no tick and no request waits for them long."""

import asyncio
import threading
import time
from collections.abc import Callable
from queue import SimpleQueue
from typing import Protocol

import structlog

from server.gate.rollout import Comparison, Forecast, forecast
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

    The planner is the gate's own. The thread is a daemon: a forecast that hangs for ever does
    not keep the process from ending; those behind it are given up by who waits for them.
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._jobs: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self.spent_s: list[float] = []

    def __enter__(self) -> "ForecastThread":
        threading.Thread(target=self._work, name="gate", daemon=True).start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._jobs.put(None)

    async def predict(self, comparison: Comparison, patience_s: float) -> Forecast | None:
        """Return the forecast, None when it is not there after `patience_s`. Never raises."""
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[Forecast | None] = loop.create_future()

        def deliver(made: Forecast | None, spent_s: float) -> None:
            self.spent_s.append(spent_s)
            if not answer.done():
                answer.set_result(made)

        def work() -> None:
            if answer.done() or loop.is_closed():
                return  # nobody waits for it any more
            began_s = time.thread_time()
            made = self._made(comparison)
            spent_s = time.thread_time() - began_s
            if not loop.is_closed():
                loop.call_soon_threadsafe(deliver, made, spent_s)

        self._jobs.put(work)
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

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            job()
