"""Browser windows on a stage: what the tests in a real Chromium share."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import httpx
from playwright.sync_api import Browser, BrowserContext, Page, expect

from tests.console.flow import TIMEOUT_MS, listen
from tests.patience import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]
MISSION = "/api/v1/missions/m1"


@dataclass(frozen=True)
class Staged:
    """A console over a scripted mission, in a process of its own."""

    address: str
    link: str
    """The path that logs in once; empty where nobody has to."""


@contextmanager
def staged(*options: str) -> Iterator[Staged]:
    """Run `tests.console.stage` with some of its options until the block ends."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.console.stage", *options],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        port, _, link = process.stdout.readline().strip().partition(" ")
        assert port, "the console did not start; its log says why"
        yield Staged(f"http://127.0.0.1:{port}", link)
    finally:
        process.stdin.close()
        try:
            process.wait(PATIENCE_S)
        finally:
            process.kill()
            process.stdout.close()


PAINTED = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
"""Until it has painted a page for the first time, a browser drops what is typed at it."""


@dataclass
class Visit:
    """One browser window on the console, and what went wrong in it."""

    page: Page
    trouble: list[str]


def visit(context: BrowserContext, address: str, scene: Literal["drawn", "blank"]) -> Visit:
    """Open the console. Software rendering takes seconds: only tests of the scene draw it."""
    page = context.new_page()
    if scene == "blank":
        page.route("**/scene/*/", lambda route: route.fulfill(body="", content_type="text/html"))
    page.set_default_timeout(TIMEOUT_MS)
    found = Visit(page, listen(page, address))
    page.goto(address)
    expect(page.locator(".team tbody tr")).to_have_count(4, timeout=TIMEOUT_MS)
    page.evaluate(PAINTED)
    return found


@contextmanager
def window(browser: Browser, address: str, scene: Literal["drawn", "blank"]) -> Iterator[Visit]:
    """A browser window of its own on the console; the mission flies again afterwards."""
    context = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="dark")
    try:
        yield visit(context, address, scene)
    finally:
        context.close()
        ask(address, "POST", f"{MISSION}/resume")


def ask(address: str, method: str, path: str, **request: Any) -> httpx.Response:
    """Ask the console's server something beside the browser; it may be slow while it draws."""
    return httpx.request(method, address + path, timeout=PATIENCE_S, **request)


def shown(visited: Visit, selector: str, words: str) -> None:
    """Wait until the first such element tells some words."""
    expect(visited.page.locator(selector).first).to_contain_text(words, timeout=TIMEOUT_MS)


def requests(page: Page, op: str) -> list[str]:
    """Return a list to which every request for an operation of the mission is added."""
    found: list[str] = []
    page.on("request", lambda asked: found.append(op) if asked.url.endswith(f"/{op}") else None)
    return found
