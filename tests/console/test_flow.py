"""A new operator's whole way through the console, in a real headless Chromium."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect, sync_playwright

from tests.console.flow import TIMEOUT_MS, Walk, listen
from tests.console.looks import ARGUMENTS, OVERLAPS, faint_texts
from tests.console.visits import staged

pytestmark = [pytest.mark.browser, pytest.mark.process, pytest.mark.timeout(600)]

READ = frozenset({"comment", "evidence", "alarms", "library"})
"""Steps after which every text's contrast is measured, dark and light."""


def faint_in_both(page: Page, axe: Axe) -> list[str]:
    """Return the texts that are too faint in either theme; the theme is as before.

    Measuring holds the page up, on a slow machine for so long that its connection is given up.
    What is tapped before there is another one is lost, so the clock must go on first.
    """
    found = []
    for _ in ("as it is", "the other"):
        found += faint_texts(page, axe)
        page.click("[data-theme-toggle]")
    clock = page.locator(".clock")
    expect(clock).not_to_have_text(clock.inner_text(), timeout=TIMEOUT_MS)
    return found


def test_a_new_operator_finds_the_whole_way(chromium: str | None) -> None:
    axe, done = Axe(), []
    with staged("--closed", "--confirm") as stage, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1440, "height": 900}, color_scheme="dark")
        page.set_default_timeout(TIMEOUT_MS)
        trouble = listen(page, stage.address)
        for step in Walk(page, stage.address + stage.link).steps():
            done.append(step)
            if step == "open":  # drawn by software the scene takes all there is
                page.evaluate("document.getElementById('scene').style.display = 'none'")
            assert page.evaluate(OVERLAPS) == [], step
            if step in READ:
                assert faint_in_both(page, axe) == [], step
        assert trouble == []
        browser.close()
    assert set(done) > READ
