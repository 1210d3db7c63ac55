"""What the tests in a browser start from.

What a page shall show may be long in coming: Playwright's own five seconds are too few.
"""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect, sync_playwright

from tests.console.flow import TIMEOUT_MS
from tests.console.looks import ARGUMENTS
from tests.console.visits import Visit, staged, window

expect.set_options(timeout=TIMEOUT_MS)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """The address of a console that shows a scripted mission."""
    with staged() as stage:
        yield stage.address


@pytest.fixture(scope="module")
def browser(chromium: str | None) -> Iterator[Browser]:
    """A headless Chromium."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def console(browser: Browser, address: str) -> Iterator[Visit]:
    """A window on the console, its scene left blank."""
    with window(browser, address, "blank") as visited:
        yield visited
