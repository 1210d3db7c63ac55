"""Waiting for something that other tasks or processes bring about."""

import asyncio
from collections.abc import Callable

from tests.patience import PATIENCE_S

STEP_S = 0.005


async def eventually(condition: Callable[[], bool], within_s: float = PATIENCE_S) -> None:
    """Return as soon as the condition holds. Raises AssertionError when it never does."""
    for _ in range(round(within_s / STEP_S)):
        if condition():
            return
        await asyncio.sleep(STEP_S)
    raise AssertionError(f"did not happen within {within_s:g} s")
