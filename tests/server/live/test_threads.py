"""Blocking work beside the event loop."""

import asyncio
import threading

import pytest

from server.live.threads import WorkThread
from tests.patience import PATIENCE_S


def failing() -> int:
    raise ValueError("this job is bad")


@pytest.mark.asyncio
async def test_results_are_delivered_on_the_loop_in_order_and_a_bad_job_costs_itself_only() -> None:
    got: list[tuple[int, threading.Thread]] = []
    done = asyncio.Event()

    def deliver(result: int) -> None:
        got.append((result, threading.current_thread()))
        if result == 3:
            done.set()

    with WorkThread("test") as thread:
        thread.submit(lambda: 1, deliver)
        thread.submit(failing, deliver)
        thread.submit(lambda: 3, deliver)
        async with asyncio.timeout(PATIENCE_S):
            await done.wait()
    here = threading.current_thread()
    assert got == [(1, here), (3, here)]


def test_a_loop_that_is_closed_meanwhile_is_not_minded(capfd: pytest.CaptureFixture[str]) -> None:
    gate, after = threading.Event(), threading.Event()

    async def begin(thread: WorkThread) -> None:
        thread.submit(lambda: gate.wait(PATIENCE_S), lambda _: None)

    async def follow(thread: WorkThread) -> None:
        thread.submit(after.set, lambda _: None)

    with WorkThread("test") as thread:
        asyncio.run(begin(thread))
        gate.set()
        asyncio.run(follow(thread))
        assert after.wait(PATIENCE_S), "it works on for whoever is there"
    assert "Traceback" not in capfd.readouterr().err
