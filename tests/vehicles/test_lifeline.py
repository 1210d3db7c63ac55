"""A process that wants to end does end, whatever its threads do."""

import subprocess
import sys

import pytest

from tests.patience import PATIENCE_S
from vehicles.lifeline import OVERRUN

BUSY = """
import asyncio, time
from vehicles.lifeline import end_within

async def main():
    asyncio.get_running_loop().run_in_executor(None, time.sleep, 600)
    end_within(0.2)

asyncio.run(main())
"""


@pytest.mark.process
def test_a_thread_that_cannot_be_cancelled_does_not_keep_the_process() -> None:
    done = subprocess.run([sys.executable, "-c", BUSY], timeout=PATIENCE_S, check=False)
    assert done.returncode == OVERRUN


@pytest.mark.process
def test_a_process_that_ends_by_itself_is_left_alone() -> None:
    code = "from vehicles.lifeline import end_within; end_within(30.0)"
    done = subprocess.run([sys.executable, "-c", code], timeout=PATIENCE_S, check=False)
    assert done.returncode == 0
