"""The keyboard and the focus, in a real headless Chromium: what holds, and what must not resume."""

import pytest
from playwright.sync_api import Page, Route, expect

from tests.console.flow import TIMEOUT_MS
from tests.console.visits import Visit, requests, shown

pytestmark = [pytest.mark.browser, pytest.mark.process]

# Keys in one piece of script follow each other at once, however busy the machine is.
PRESS = """
(keys) => {
  for (const [selector, key, repeat] of keys) {
    const code = { " ": "Space", Enter: "Enter" }[key] ?? `Key${key.toUpperCase()}`;
    const goal = document.querySelector(selector);
    goal.focus();
    goal.dispatchEvent(new KeyboardEvent("keydown", { key, code, repeat, bubbles: true }));
  }
}
"""


def press(page: Page, *keys: tuple[str, str, bool]) -> None:
    """Let keys come down one after the other: where, which, and whether it is a repetition."""
    page.evaluate(PRESS, [list(key) for key in keys])


def test_who_types_on_after_enter_sets_nothing_moving(console: Visit) -> None:
    page = console.page
    page.keyboard.press("Space")
    shown(console, ".mission .chip", "held")
    asked = requests(page, "resume")
    page.fill(".comment-box", "Stay away from zone s1.")
    press(page, (".comment-box", "Enter", False), ("body", "r", False), ("body", "o", False))
    shown(console, "#notice", "R came amid typing")
    expect(page.locator(".comment-box")).not_to_be_focused(timeout=TIMEOUT_MS)
    assert asked == []
    page.wait_for_function("!falconer.typedLately()")
    page.keyboard.press("R")  # Caps Lock
    shown(console, ".mission .chip", "running")
    assert asked == ["resume"]


def test_a_key_that_is_kept_down_is_one_word(console: Visit) -> None:
    asked = requests(console.page, "hold")
    press(console.page, ("body", " ", False), *[("body", " ", True)] * 5)
    shown(console, ".mission .chip", "held")
    assert asked == ["hold"]


def test_space_holds_from_a_list_of_options_and_opens_none(console: Visit) -> None:
    page = console.page
    page.keyboard.press("5")
    options = page.get_by_label("Seeds")
    expect(options).to_have_value("5")  # the one of several that is named
    expect(page.get_by_label("Kind")).to_have_value("ablation")  # else the first
    options.focus()
    page.keyboard.press("Space")
    shown(console, ".mission .chip", "held")
    page.keyboard.press("Escape")
    expect(options).not_to_be_focused()


def test_a_server_that_does_not_answer_is_told_of(console: Visit) -> None:
    page, waiting = console.page, list[Route]()
    page.route("**/hold", lambda route: waiting.append(route))
    page.keyboard.press("Space")
    shown(console, "#notice", "Hold is on its way: the server has not answered yet.")
    waiting[0].continue_()
    shown(console, ".mission .chip", "held")


def test_hold_says_so_where_there_is_nothing_to_hold(console: Visit) -> None:
    page = console.page
    asked = requests(page, "hold")
    page.evaluate("falconer.show('', 'unknown'); falconer.steer('hold')")
    shown(console, "#notice", "Hold did nothing: this page knows of no mission yet.")
    assert asked == []
