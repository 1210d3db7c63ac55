"""The way into the console, in a real browser: the one-time link, the login page, both roles."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import BrowserContext, expect, sync_playwright
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from tests.console.flow import TIMEOUT_MS
from tests.console.stage import VIEWER
from tests.console.visits import MISSION, Staged, ask, staged

pytestmark = [pytest.mark.browser, pytest.mark.process]

ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]


@pytest.fixture(scope="module")
def console() -> Iterator[Staged]:
    with staged("--closed") as stage:
        yield stage


@pytest.fixture
def fresh() -> Iterator[Staged]:
    """A console whose link nobody has used."""
    with staged("--closed") as stage:
        yield stage


@pytest.fixture
def context(chromium: str | None) -> Iterator[BrowserContext]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        context = browser.new_context(viewport={"width": 1440, "height": 900})
        context.set_default_timeout(TIMEOUT_MS)
        context.route("**/scene/*/", lambda route: route.fulfill(body="", content_type="text/html"))
        yield context
        browser.close()


def state(console: Staged) -> str:
    headers = {"authorization": f"Bearer {VIEWER.get_secret_value()}"}
    found: str = ask(console.address, "GET", MISSION, headers=headers).json()["state"]
    return found


def test_the_link_logs_in_once_and_the_console_steers(
    fresh: Staged, context: BrowserContext
) -> None:
    page = context.new_page()
    page.goto(fresh.address + fresh.link, timeout=TIMEOUT_MS)
    expect(page.locator("html")).to_have_attribute("data-state", "running", timeout=TIMEOUT_MS)
    page.keyboard.press("Space")
    expect(page.locator("html")).to_have_attribute("data-state", "held", timeout=TIMEOUT_MS)
    assert state(fresh) == "held"
    page.reload(timeout=TIMEOUT_MS)  # the session goes on
    expect(page.locator("html")).to_have_attribute("data-state", "held", timeout=TIMEOUT_MS)
    page.keyboard.press("r")
    expect(page.locator("html")).to_have_attribute("data-state", "running", timeout=TIMEOUT_MS)
    context.clear_cookies()
    again = page.goto(fresh.address + fresh.link, timeout=TIMEOUT_MS)
    assert again is not None
    assert again.status == 401
    expect(page.get_by_role("alert")).to_contain_text("has been used")


def test_a_viewer_logs_in_by_the_page_and_only_looks(
    console: Staged, context: BrowserContext
) -> None:
    page = context.new_page()
    page.goto(console.address, timeout=TIMEOUT_MS)
    assert page.url.endswith("/login")
    page.get_by_label("Token").fill("not-a-token-at-all")
    page.get_by_role("button", name="Log in").click()
    expect(page.get_by_role("alert")).to_contain_text("not known", timeout=TIMEOUT_MS)
    page.get_by_label("Token").fill(VIEWER.get_secret_value())
    page.get_by_role("button", name="Log in").click()
    expect(page.locator("html")).to_have_attribute("data-state", "running", timeout=TIMEOUT_MS)
    page.keyboard.press("Space")
    expect(page.locator("#notice")).to_contain_text("needs the role operator", timeout=TIMEOUT_MS)
    expect(page.locator(".receipts")).to_be_visible(timeout=TIMEOUT_MS)
    expect(page.locator(".comment-box")).to_have_count(0)
    page.click("[data-tap='pair:21:122']")
    expect(page.locator("#notice")).to_contain_text("You may look", timeout=TIMEOUT_MS)
    expect(page.locator("[data-view=fit]")).to_be_visible()
    for control in ("[data-draw]", "[data-zone-erase]", "[data-weights]:visible"):
        expect(page.locator(control)).to_have_count(0)
    expect(page.locator("[data-field=weight-tracking]")).to_be_disabled()
    assert state(console) == "running"


@pytest.mark.parametrize(
    "path", ["/scene", "/scene/", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"]
)
def test_a_socket_of_the_console_needs_a_login(console: Staged, path: str) -> None:
    url = console.address.replace("http", "ws") + path
    with pytest.raises(InvalidStatus) as refused:
        connect(url, origin=Origin(console.address))
    assert refused.value.response.status_code == 401


@pytest.mark.parametrize("path", ["/", "/scene/", "/console/console.js"])
def test_a_page_of_the_console_needs_a_login(console: Staged, path: str) -> None:
    assert ask(console.address, "GET", path).status_code == 401
