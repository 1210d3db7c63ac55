"""Commands that work until they are told to stop."""

import asyncio
import contextlib
import logging
import signal
from collections.abc import Coroutine
from typing import Any

from vehicles.logs import configure_logs


async def until_interrupted(work: Coroutine[Any, Any, None]) -> None:
    """Run until the work ends, or SIGINT or SIGTERM asks for an orderly end."""
    task = asyncio.ensure_future(work)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task


def log_to_stderr() -> None:
    """Let the vehicles' log go to standard error, one line an entry."""
    configure_logs(libraries=logging.INFO)
