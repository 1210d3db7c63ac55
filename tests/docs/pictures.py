"""Flies the tutorial in a real browser and draws its pictures anew (`make docs`); no test.

    python -m tests.docs.pictures FOLDER

Whatever the tutorial says one sees is waited for; what does not come ends the program.
"""

import argparse
import base64
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

from playwright.sync_api import Page, ViewportSize, expect, sync_playwright

from tests.conftest import BROWSERS
from tests.console.flow import MANY_COLOURS, TIMEOUT_MS, listen
from tests.console.looks import ARGUMENTS

LINK = re.compile(r"(http://127\.0\.0\.1:\d+)/login\?key=\S+")
SIZE: ViewportSize = {"width": 1440, "height": 900}
QUALITY = 60
SETTLED_MS = 25_000
"""So long the team flies before the first picture: trails, a zone or two, a first decision."""
SENTENCE = "The Drone 0 should focus on tracking target 1."
COUNTS = """() => document.querySelectorAll(".receipt.applied, .receipt.noted").length > 0"""


@contextmanager
def flying(scenario: str) -> Iterator[str]:
    """Fly a scenario live as the tutorial does; yields the operator's link."""
    program = str(Path(sys.executable).parent / "falconer")
    command = [program, "run", scenario, "--port", "0"]
    with TemporaryDirectory() as state:
        settings = os.environ | {"XDG_STATE_HOME": state}
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=settings)
        assert process.stderr is not None
        try:
            yield next(found[0] for line in process.stderr if (found := LINK.search(line)))
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=30)


def draw(page: Page, file: Path) -> None:
    """Save what the window shows as WebP, which Playwright itself does not write."""
    session = page.context.new_cdp_session(page)
    shot = session.send("Page.captureScreenshot", {"format": "webp", "quality": QUALITY})
    file.write_bytes(base64.b64decode(shot["data"]))
    sys.stdout.write(f"{file.name} {file.stat().st_size // 1024} KiB\n")


def tutorial(page: Page, link: str, folder: Path) -> None:
    """Do what the tutorial does, a picture after each of its steps."""
    page.goto(link)
    expect(page.locator(".team tbody tr")).to_have_count(4, timeout=TIMEOUT_MS)
    page.wait_for_function(MANY_COLOURS, timeout=TIMEOUT_MS)
    page.wait_for_timeout(SETTLED_MS)
    draw(page, folder / "first-look.webp")
    page.keyboard.press("/")
    page.fill(".comment-box", SENTENCE)
    page.press(".comment-box", "Enter")
    page.wait_for_function(COUNTS, timeout=TIMEOUT_MS)
    page.wait_for_timeout(2_000)
    draw(page, folder / "receipt.webp")
    page.locator(".receipt [data-reveal^='d']").first.click(timeout=TIMEOUT_MS)
    page.wait_for_timeout(2_000)
    draw(page, folder / "decision.webp")
    page.keyboard.press("Escape")
    page.keyboard.press("Space")
    held = page.locator(".mission .chip", has_text="held")
    expect(held).to_be_visible(timeout=TIMEOUT_MS)
    page.wait_for_timeout(2_000)
    draw(page, folder / "held.webp")
    page.keyboard.press("r")
    expect(page.locator(".mission .chip", has_text="running")).to_be_visible(timeout=TIMEOUT_MS)


def main() -> int:
    """Draw all pictures; 1 where the page complained."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    browser = next((path for name in BROWSERS if (path := which(name))), None)
    with flying("demo") as link, sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=browser, args=ARGUMENTS)
        page = launched.new_page(viewport=SIZE, color_scheme="dark")
        page.set_default_timeout(TIMEOUT_MS)
        trouble = listen(page, link.partition("/login")[0])
        tutorial(page, link, folder)
        launched.close()
    sys.stdout.write("".join(f"{each}\n" for each in trouble))
    return 1 if trouble else 0


if __name__ == "__main__":
    sys.exit(main())
