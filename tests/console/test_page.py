"""The console in a real headless Chromium, over a scripted mission."""

import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from tests.console.flow import FOCUS, MANY_COLOURS, TIMEOUT_MS
from tests.console.looks import OVERLAPS
from tests.console.visits import MISSION, Visit, ask, requests, shown, staged, visit, window
from tests.patience import PATIENCE_S

pytestmark = [pytest.mark.browser, pytest.mark.process]

TAKES_CLICKS = """
() => document.getElementById("scene").contentWindow.__viserPointer?.hasSceneClickFilter()
""".strip()
NO_VIEW = "document.getElementById('notice').textContent.includes('shows no scene')"


def snapshot(address: str) -> dict[str, Any]:
    found: dict[str, Any] = ask(address, "GET", f"{MISSION}/snapshot").json()
    return found


def comments(address: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = ask(address, "GET", f"{MISSION}/comments").json()
    return found


def page_until(page: Page, condition: Callable[[], bool]) -> None:
    """Wait for what comes with the next snapshot; the page goes on meanwhile."""
    until_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until_s, "did not happen"
        page.wait_for_timeout(20)


@pytest.fixture
def fresh(browser: Browser) -> Iterator[Visit]:
    """A window on a mission in which nobody has said anything yet."""
    with staged() as stage, window(browser, stage.address, "blank") as visited:
        yield visited


def test_a_comment_is_answered_and_the_assignment_follows(fresh: Visit) -> None:
    page = fresh.page
    cell = page.locator("[title^='robot 21, target 122: assigned']")
    expect(cell).to_have_count(0)
    page.fill(".comment-box", FOCUS)
    page.press(".comment-box", "Enter")
    shown(fresh, ".receipt", FOCUS)
    shown(fresh, ".receipt.applied .chip", "Applied")
    shown(fresh, ".receipt .answer", "Robot 21 takes target 122")
    expect(cell).to_have_count(1, timeout=TIMEOUT_MS)
    shown(fresh, ".events", "Robot 21 now tracks targets 121, 122.")
    expect(page.locator(".comment-box")).to_have_value("")
    assert fresh.trouble == []


@pytest.mark.parametrize("leave", ["Enter", "Escape"])
def test_space_holds_again_once_the_box_is_left(console: Visit, leave: str) -> None:
    page = console.page
    page.fill(".comment-box", "Track more boldly.")
    page.press(".comment-box", leave)
    expect(page.locator(".comment-box")).not_to_be_focused(timeout=TIMEOUT_MS)
    page.keyboard.press("Space")
    shown(console, ".mission .chip", "held")


def test_mission_time_goes_on_and_the_lamps_are_lit(console: Visit) -> None:
    clock = console.page.locator(".clock")
    before = clock.inner_text()
    expect(clock).not_to_have_text(before, timeout=TIMEOUT_MS)
    expect(console.page.locator(".lamps .lamp")).to_have_count(3)
    shown(console, ".mission", "scripted")


def test_the_hold_button_holds_and_typing_a_space_does_not(console: Visit) -> None:
    page = console.page
    asked = requests(page, "hold")
    page.fill(".comment-box", "first")
    page.type(".comment-box", " and second")
    expect(page.locator(".comment-box")).to_have_value("first and second")
    assert asked == []
    shown(console, ".mission .chip", "running")
    page.click("[data-steer=hold]")
    shown(console, ".mission .chip", "held")
    page.click("[data-steer=resume]")
    shown(console, ".mission .chip", "running")


def test_a_suggestion_fills_the_box_and_sends_nothing(console: Visit, address: str) -> None:
    said = len(comments(address))
    chip = console.page.locator(".chip-button").first
    chip.hover()
    # What is done later has been answered: the server knows of the pointer, and none changes now.
    console.page.locator("[data-field=weight-tracking]").fill("1000")
    shown(console, ".trial", "1000 is not")
    words = chip.inner_text()
    chip.click()
    expect(console.page.locator(".comment-box")).to_have_value(words, timeout=TIMEOUT_MS)
    assert len(comments(address)) == said


def test_what_people_write_is_not_run(console: Visit) -> None:
    page = console.page
    page.fill(".comment-box", "<img src=x onerror=\"document.title='owned'\">")
    page.press(".comment-box", "Enter")
    shown(console, ".receipt", "<img src=x")
    assert page.title() == "Falconer"
    assert page.locator(".receipt img").count() == 0


def test_the_scene_is_drawn_and_space_holds_even_from_within_it(
    browser: Browser, address: str
) -> None:
    """The canvas shows many colours, and nothing of the viewer's own furniture."""
    with window(browser, address, "drawn") as visited:
        page = visited.page
        page.wait_for_function(MANY_COLOURS, timeout=TIMEOUT_MS)
        expect(page.frame_locator("#scene").locator("[data-floating-window]")).to_be_hidden()
        page.click("#scene", position={"x": 40, "y": 40})
        page.keyboard.press("Space")
        shown(visited, ".mission .chip", "held")
        expect(page.locator("[data-steer=resume]")).to_be_enabled(timeout=TIMEOUT_MS)
        page.keyboard.press("r")
        shown(visited, ".mission .chip", "running")
        assert visited.trouble == []


def test_a_pair_is_pinned_kept_apart_and_freed_by_keyboard(console: Visit, address: str) -> None:
    page = console.page
    cell = page.locator("[data-tap='pair:34:123']")
    around = page.locator("td:has([data-tap='pair:34:123'])")
    ask(address, "DELETE", f"{MISSION}/pins/r34-t123")  # it is free, whatever was tried before
    expect(around).not_to_have_class(re.compile(r"\b(pin|forbid)\b"), timeout=TIMEOUT_MS)
    cell.focus()
    for tone, words in (("pin", "pinned by operator"), ("forbid", "kept apart by operator")):
        page.keyboard.press("Enter")
        expect(around).to_have_class(re.compile(rf"\b{tone}\b"), timeout=TIMEOUT_MS)
        expect(cell).to_have_attribute("title", re.compile(words), timeout=TIMEOUT_MS)
        expect(cell).to_be_focused(timeout=TIMEOUT_MS)
    page.keyboard.press("Enter")
    expect(around).not_to_have_class(re.compile(r"\b(pin|forbid)\b"), timeout=TIMEOUT_MS)
    page.keyboard.press("ArrowLeft")
    expect(page.locator("[data-tap='pair:34:122']")).to_be_focused()
    assert console.trouble == []


def test_weights_are_tried_here_and_put_in_force_as_one(console: Visit, address: str) -> None:
    page = console.page
    field = page.locator("[data-field=weight-tracking]")
    expect(page.locator("[data-weights=apply]")).to_be_disabled()
    field.fill("1000")
    shown(console, ".trial", "Tracking: 1000 is not from 1 to 100.")
    field.fill("40")
    shown(console, ".trial", "Tried here")
    page.keyboard.press("Space")
    shown(console, ".mission .chip", "held")
    page.click("[data-weights=apply]")
    expect(page.locator("[data-weights=apply]")).to_be_disabled(timeout=TIMEOUT_MS)
    shown(console, "[data-weight=tracking] .weight-history", "operator, ")
    page_until(page, lambda: snapshot(address)["directives"]["weights"]["tracking"] == 40.0)


def zones(address: str) -> dict[str, dict[str, Any]]:
    return {zone["id"]: zone for zone in snapshot(address)["zones"]}


def begin_zone(visited: Visit, begin: Callable[[], object]) -> None:
    """Begin to draw, until clicks are taken: the server may have yet to hear of this page's view.

    Then it says so, and whoever draws begins once more.
    """
    page = visited.page
    while True:
        page.evaluate("document.getElementById('notice').textContent = ''")
        begin()
        shown(visited, ".draw-hint", "Click the centre")
        page.wait_for_function(f"() => ({TAKES_CLICKS})() || {NO_VIEW}")
        if page.evaluate(TAKES_CLICKS):
            return
        leave_zone(visited)


def leave_zone(visited: Visit) -> None:
    """Think better of it; the scene must know, too, before a click in it means something else."""
    visited.page.keyboard.press("Escape")
    expect(visited.page.locator(".draw-hint")).to_be_hidden(timeout=TIMEOUT_MS)
    visited.page.wait_for_function(f"() => !({TAKES_CLICKS})()")


def test_a_zone_is_drawn_on_the_scene_erased_and_brought_back(
    browser: Browser, address: str
) -> None:
    """Its centre and its rim are clicked in the scene itself, behind our proxy."""
    with window(browser, address, "drawn") as visited:
        page = visited.page
        page.wait_for_function(MANY_COLOURS, timeout=TIMEOUT_MS)
        box = page.locator("#scene").bounding_box()
        assert box is not None
        before = zones(address)
        begin_zone(visited, lambda: page.keyboard.press("z"))
        x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.55 * box["height"]
        page.mouse.click(x, y)
        shown(visited, ".draw-hint", "Now click the rim")
        leave_zone(visited)
        begin_zone(visited, lambda: page.click("[data-draw=start]"))
        page.mouse.click(x, y)
        shown(visited, ".draw-hint", "Now click the rim")
        page.mouse.click(x + 0.1 * box["width"], y)
        shown(visited, ".draw-hint", "Check the numbers")
        east, radius = (
            float(page.locator(f"[data-field=zone-{name}]").input_value()) for name in ("x", "long")
        )
        assert abs(east) < 0.5  # the middle of the view is the middle of the field
        assert 0.3 < radius < 4.0
        page.locator(".draw-kind").get_by_text("communication").click()
        page.click("[data-draw=confirm]")
        shown(visited, "#notice", "is drawn")
        page_until(page, lambda: len(zones(address)) > len(before))
        (name,) = zones(address).keys() - before.keys()
        assert zones(address)[name]["kind"] == "communication"
        assert zones(address)[name]["mean"][0] == pytest.approx(east)
        page.get_by_role("tab", name="Zones").click()
        shown(visited, f"[data-zone={name}]", "drawn by operator")
        page.click(f"[data-zone-erase={name}]")
        expect(page.locator(f"[data-zone={name}]")).to_have_count(0, timeout=TIMEOUT_MS)
        page.click("[data-zones=undo]")
        shown(visited, "#notice", "is back as")
        page_until(page, lambda: len(zones(address)) == len(before) + 1)
        assert visited.trouble == []


ROWS = """
() => new Set([...document.querySelectorAll('.aside-card .tab-list button')]
    .map((tab) => tab.getBoundingClientRect().top)).size
"""


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (1920, 1080)])
@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_nothing_overlaps(
    browser: Browser, address: str, width: int, height: int, scheme: str
) -> None:
    context = browser.new_context(
        viewport={"width": width, "height": height},
        color_scheme=scheme,  # type: ignore[arg-type]
    )
    visited = visit(context, address, "blank")
    assert visited.page.evaluate(OVERLAPS) == []
    assert visited.page.evaluate(ROWS) == 1, "the tabs beside the scene stand in one row"
    assert visited.page.locator("html").get_attribute("data-theme") == scheme
    visited.page.click("[data-theme-toggle]")
    other = {"dark": "light", "light": "dark"}[scheme]
    assert visited.page.locator("html").get_attribute("data-theme") == other
    context.close()


def test_smaller_screens_scroll_and_keep_hold_in_sight(console: Visit) -> None:
    page = console.page
    sizes = ((1360, 800), (1280, 720), (1180, 800), (1000, 800), (900, 700), (390, 844))
    for width, height in sizes:
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_function(
            "([w, h]) => innerWidth === w && innerHeight === h", arg=[width, height]
        )
        page.evaluate("scrollTo(0, 0)")
        assert page.evaluate(OVERLAPS) == [], width
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate("document.querySelector('.console').offsetWidth") == width
        page.evaluate("scrollTo(0, document.body.scrollHeight)")
        expect(page.locator("[data-steer=hold]")).to_be_in_viewport(ratio=1.0)


def test_the_smallest_screen_that_does_not_scroll_covers_nothing(console: Visit) -> None:
    console.page.set_viewport_size({"width": 1366, "height": 768})
    console.page.wait_for_function("innerWidth === 1366 && innerHeight === 768")
    assert console.page.evaluate(OVERLAPS) == []
    deck, aside = (console.page.locator(what).bounding_box() for what in (".limits-card", "aside"))
    assert deck is not None
    assert aside is not None
    assert deck["x"] + deck["width"] <= aside["x"]


def test_a_second_browser_shows_the_same(browser: Browser, address: str, console: Visit) -> None:
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    other = visit(context, address, "blank")
    said = len(comments(address))
    for visited in (console, other):
        expect(visited.page.locator(".receipt")).to_have_count(said, timeout=TIMEOUT_MS)
    context.close()


@pytest.mark.parametrize(
    "path", ["/scene", "/scene/", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"]
)
def test_a_foreign_page_gets_no_socket(address: str, path: str) -> None:
    url = address.replace("http", "ws") + path
    with pytest.raises(InvalidStatus) as refused:
        connect(url, origin=Origin("https://evil.example"))
    assert refused.value.response.status_code == 403


@pytest.mark.parametrize("path", ["/", "/scene/", "/console/console.js"])
def test_a_foreign_name_gets_no_page(address: str, path: str) -> None:
    assert ask(address, "GET", path, headers={"host": "evil.example"}).status_code == 421
    answer = ask(address, "GET", path)
    assert answer.status_code == 200
    assert "frame-ancestors 'self'" in answer.headers["content-security-policy"]


PAGE = """
import asyncio
from nicegui import core
from nicegui.client import Client
from console.page import mount
from tests.server.api.serving import OpenDoor, Stage, served
from server.api.app import create_app
from server.settings import Settings
import httpx

async def main():
    app = create_app(Settings(), Stage().service, mount, OpenDoor())
    async with served(app) as address, httpx.AsyncClient() as browser:
        (await browser.get(f"http://{address}/")).raise_for_status()
        (client,) = Client.instances.values()
        print(client.page.resolve_reconnect_timeout(), core.app.config.reconnect_timeout)

asyncio.run(main())
"""


def test_what_is_typed_outlasts_an_outage_that_is_soon_noticed(root: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PAGE], cwd=root, capture_output=True, text=True, check=True
    )
    kept_s, noticed_s = map(float, done.stdout.split())
    assert kept_s >= 60.0
    assert noticed_s <= 10.0
