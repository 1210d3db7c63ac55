"""What runs beside a live mission gives way to it."""

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from server.live.priority import NICENESS, give_way

WAIT = "import sys; sys.stdin.read()"


@pytest.fixture
def waiting() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-c", WAIT], stdin=subprocess.PIPE) as process:
        yield process
        process.kill()


def niceness(process: subprocess.Popen[bytes]) -> int:
    return os.getpriority(os.PRIO_PROCESS, process.pid)


def test_it_runs_after_the_mission(waiting: subprocess.Popen[bytes]) -> None:
    give_way(waiting.pid)
    assert niceness(waiting) == max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0))


def test_what_gives_way_already_is_left_alone(waiting: subprocess.Popen[bytes]) -> None:
    os.setpriority(os.PRIO_PROCESS, waiting.pid, 19)
    give_way(waiting.pid)
    assert niceness(waiting) == 19


def test_what_has_ended_needs_no_priority(waiting: subprocess.Popen[bytes]) -> None:
    waiting.kill()
    waiting.wait()
    give_way(waiting.pid)
