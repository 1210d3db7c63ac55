"""What holds for every test: no network beyond this machine, and one way to find a browser.

The time-out of every test and "warnings are errors" stand in `pyproject.toml`.
"""

import os
import shutil
from pathlib import Path
from tempfile import mkdtemp

import pytest
from hypothesis import settings
from xdist.remote import Producer

from tests.network import block_network
from tests.sharing import BothEnds

TIMED_BY_OTHERS = ("browser", "process", "sockets")
"""Markers of tests whose events come from outside this process, in no fixed order."""

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
ROOT = Path(__file__).resolve().parent.parent


def pytest_unconfigure() -> None:
    """Remove the journals of servers that the tests started."""
    shutil.rmtree(os.environ["XDG_STATE_HOME"], ignore_errors=True)


def pytest_configure() -> None:
    """Close the network before the first test module is imported; no test races a clock.

    Examples are derived from the test itself, so that a run that passed passes again.
    """
    block_network()
    os.environ["XDG_STATE_HOME"] = mkdtemp(prefix="falconer-tests-")
    settings.register_profile("falconer", deadline=None, derandomize=True)
    settings.load_profile("falconer")


def timed_by_others(item: pytest.Item) -> bool:
    """Whether events of a test come from other processes."""
    return any(item.get_closest_marker(name) for name in TIMED_BY_OTHERS)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let what other processes time come first, file by file, and fail once.

    The summary names each test that had to run twice, and twice is a failure: one that only passed
    at its second run has shown a race, of its own or of the product's.
    """
    timed = list(filter(timed_by_others, items))
    for item in timed:
        item.add_marker(pytest.mark.flaky(reruns=1))
    files = {item.path for item in timed}
    items.sort(key=lambda item: item.path not in files)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> BothEnds:
    """Share the tests between the processes of `--numprocesses`."""
    config.option.loadscopereorder = False
    return BothEnds(config, log)


@pytest.fixture(scope="session")
def root() -> Path:
    """Return the folder of the checkout."""
    return ROOT


@pytest.fixture(scope="session")
def chromium() -> str | None:
    """Return the system's Chromium, None where Playwright shall use the one it downloaded."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)
