"""Endless work beside other work."""

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from typing import Any


@asynccontextmanager
async def alongside(work: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    """Do endless work for the life of the context; either one's failure ends the other.

    A lone error is raised as it is, not as a group of one.
    """
    try:
        async with asyncio.TaskGroup() as tasks:
            running = tasks.create_task(work)
            try:
                yield
            finally:
                running.cancel()
    except BaseExceptionGroup as group:
        if len(group.exceptions) == 1:
            raise group.exceptions[0] from None
        raise
