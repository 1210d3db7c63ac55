"""The list of decisions in a real headless Chromium."""

from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.console.visits import MISSION, Visit, ask, shown, staged

pytestmark = [pytest.mark.browser, pytest.mark.process]


@pytest.fixture
def address() -> Iterator[str]:
    """A mission in which nothing has been decided yet."""
    with staged() as stage:
        yield stage.address


def decide(address: str, *kinds: str) -> None:
    """Let somebody decide something: `pin` changes something, `none` nothing."""
    asked: dict[str, tuple[str, dict[str, Any]]] = {
        "pin": ("pins/keep", {"robot": 21, "target": 124}),
        "none": ("capacities", {"capacities": {"21": 2}}),
    }
    for kind in kinds:
        path, body = asked[kind]
        ask(address, "PUT", f"{MISSION}/{path}", json=body).raise_for_status()


def test_what_changed_nothing_is_one_line_between_what_did(console: Visit, address: str) -> None:
    page = console.page
    decide(address, "pin", "none", "none", "none", "pin", "none")
    page.keyboard.press("2")
    lines = page.locator(".decisions .unchanging")
    expect(lines).to_have_count(2)
    shown(console, ".decisions .unchanging", "No change, once")
    listed = page.locator(".decisions > div:visible")
    expect(listed).to_have_count(4)
    for place, words in enumerate(("once", "pinned", "3 times", "pinned")):
        expect(listed.nth(place)).to_contain_text(words)
    decide(address, "none")
    shown(console, ".decisions .unchanging", "No change, 2 times")
    expect(listed).to_have_count(4)
    page.click("[data-filter=all]")
    expect(listed).to_have_count(7)
    expect(lines.first).to_be_hidden()
    assert console.trouble == []
