"""The console in a real headless Chromium, over a scripted mission."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

pytestmark = [pytest.mark.browser, pytest.mark.process, pytest.mark.timeout(120)]

ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]
FOCUS = "The Drone 21 should focus on tracking target 122."
TIMEOUT_MS = 30_000

OVERLAPS = """
() => {
  const cards = [...document.querySelectorAll(".console > .bar, .stage, .card")];
  const boxes = cards.map((card) => [card.className, card.getBoundingClientRect()]);
  const found = [];
  for (const [i, [a, p]] of boxes.entries()) {
    if (p.left < 0 || p.top < 0 || p.right > innerWidth + 1 || p.bottom > innerHeight + 1)
      found.push(`${a} leaves the window`);
    for (const [b, q] of boxes.slice(i + 1)) {
      const beside = p.left > q.right - 1 || q.left > p.right - 1;
      const above = p.top > q.bottom - 1 || q.top > p.bottom - 1;
      if (!beside && !above) found.push(`${a} overlaps ${b}`);
    }
  }
  const bar = [...document.querySelectorAll(".bar > *")].map((e) => e.getBoundingClientRect());
  for (let i = 1; i < bar.length; i++)
    if (bar[i].width && bar[i].left < bar[i - 1].right - 1) found.push(`bar item ${i} overlaps`);
  return found;
}
"""


MANY_COLOURS = """
() => {
  const scene = document.getElementById("scene").contentDocument;
  const canvas = [...scene.querySelectorAll("canvas")].find((c) => c.dataset.engine);
  if (!canvas) return false;
  const copy = document.createElement("canvas");
  copy.width = copy.height = 64;
  const pen = copy.getContext("2d");
  pen.drawImage(canvas, 0, 0, 64, 64);
  const pixels = pen.getImageData(0, 0, 64, 64).data;
  const seen = new Set();
  for (let i = 0; i < pixels.length; i += 4)
    if (pixels[i + 3] > 40) seen.add([...pixels.slice(i, i + 3)].map((c) => c >> 5).join());
  return seen.size > 8;
}
"""


@pytest.fixture(scope="module")
def address(root: Path) -> Iterator[str]:
    """The address of a console that shows a scripted mission."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.console.stage"],
        cwd=root,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    port = process.stdout.readline().strip()
    assert port, "the console did not start; its log says why"
    yield f"http://127.0.0.1:{port}"
    process.stdin.close()
    process.wait(20)
    process.stdout.close()


@pytest.fixture(scope="module")
def browser(chromium: str | None) -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        yield browser
        browser.close()


@dataclass
class Visit:
    """One browser window on the console, and what went wrong in it."""

    page: Page
    trouble: list[str] = field(default_factory=list)


def visit(context: BrowserContext, address: str, scene: Literal["drawn", "blank"]) -> Visit:
    """Open the console. Software rendering takes seconds: only tests of the scene draw it."""
    page = context.new_page()
    if scene == "blank":
        page.route("**/scene/", lambda route: route.fulfill(body="", content_type="text/html"))
    page.set_default_timeout(TIMEOUT_MS)
    found = Visit(page)
    own = (address, address.replace("http", "ws"), "data:", "blob:")
    page.on(
        "console",
        lambda said: found.trouble.append(said.text) if said.type == "error" else None,
    )
    page.on("pageerror", lambda error: found.trouble.append(str(error)))
    page.on(
        "request",
        lambda asked: (
            found.trouble.append(f"request to {asked.url}")
            if not asked.url.startswith(own)
            else None
        ),
    )
    page.goto(address)
    expect(page.locator(".team tbody tr")).to_have_count(4, timeout=TIMEOUT_MS)
    return found


@contextmanager
def window(browser: Browser, address: str, scene: Literal["drawn", "blank"]) -> Iterator[Visit]:
    """A browser window of its own on the console; the mission flies again afterwards."""
    context = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="dark")
    try:
        yield visit(context, address, scene)
    finally:
        context.close()
        httpx.post(f"{address}/api/v1/missions/m1/resume")


@pytest.fixture
def console(browser: Browser, address: str) -> Iterator[Visit]:
    with window(browser, address, "blank") as visited:
        yield visited


def shown(visited: Visit, selector: str, words: str) -> None:
    expect(visited.page.locator(selector).first).to_contain_text(words, timeout=TIMEOUT_MS)


def test_a_comment_is_answered_and_the_assignment_follows(console: Visit) -> None:
    page = console.page
    cell = page.locator("[title^='robot 21, target 122: assigned']")
    expect(cell).to_have_count(0)
    page.fill(".comment-box", FOCUS)
    page.press(".comment-box", "Enter")
    shown(console, ".receipt", FOCUS)
    shown(console, ".receipt.applied .chip", "Applied")
    shown(console, ".receipt .answer", "Robot 21 takes target 122")
    expect(cell).to_have_count(1, timeout=TIMEOUT_MS)
    shown(console, ".events", "Robot 21 now tracks targets 121, 122.")
    expect(page.locator(".comment-box")).to_have_value("")
    assert console.trouble == []


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
    expect(console.page.locator(".lamp")).to_have_count(3)
    shown(console, ".mission", "scripted")


def test_the_hold_button_holds_and_typing_a_space_does_not(console: Visit) -> None:
    page = console.page
    page.fill(".comment-box", "first")
    page.type(".comment-box", " and second")
    expect(page.locator(".comment-box")).to_have_value("first and second")
    shown(console, ".mission .chip", "running")
    page.click("[data-steer=hold]")
    shown(console, ".mission .chip", "held")
    page.click("[data-steer=resume]")
    shown(console, ".mission .chip", "running")


def test_a_suggestion_fills_the_box_and_sends_nothing(console: Visit, address: str) -> None:
    said = len(httpx.get(f"{address}/api/v1/missions/m1/comments").json())
    chip = console.page.locator(".chip-button").first
    words = chip.inner_text()
    chip.click()
    expect(console.page.locator(".comment-box")).to_have_value(words, timeout=TIMEOUT_MS)
    assert len(httpx.get(f"{address}/api/v1/missions/m1/comments").json()) == said


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
        page.wait_for_function(MANY_COLOURS, timeout=60_000)
        expect(page.frame_locator("#scene").locator("[data-floating-window]")).to_be_hidden()
        page.click("#scene", position={"x": 40, "y": 40})
        page.keyboard.press("Space")
        shown(visited, ".mission .chip", "held")
        expect(page.locator("[data-steer=resume]")).to_be_enabled(timeout=TIMEOUT_MS)
        page.keyboard.press("r")
        shown(visited, ".mission .chip", "running")
        assert visited.trouble == []


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
    assert visited.page.locator("html").get_attribute("data-theme") == scheme
    visited.page.click("[data-theme-toggle]")
    other = {"dark": "light", "light": "dark"}[scheme]
    assert visited.page.locator("html").get_attribute("data-theme") == other
    context.close()


def test_a_second_browser_shows_the_same(browser: Browser, address: str, console: Visit) -> None:
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    other = visit(context, address, "blank")
    comments = httpx.get(f"{address}/api/v1/missions/m1/comments").json()
    for visited in (console, other):
        expect(visited.page.locator(".receipt")).to_have_count(len(comments), timeout=TIMEOUT_MS)
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
    assert httpx.get(address + path, headers={"host": "evil.example"}).status_code == 421
    answer = httpx.get(address + path)
    assert answer.status_code == 200
    assert "frame-ancestors 'self'" in answer.headers["content-security-policy"]
