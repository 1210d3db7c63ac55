"""Pictures of every step of an operator's way, dark and light, small and large; no test.

    python -m tests.console.screenshots FOLDER

Tells of overlaps, cut and faint texts, errors on the browser's console and requests to elsewhere,
and exits with 1 when there were any.
"""

import argparse
import sys
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Playwright, sync_playwright

from tests.console.flow import TIMEOUT_MS, Walk, listen
from tests.console.looks import ARGUMENTS, CUT, OVERLAPS, faint_texts
from tests.console.visits import staged

SIZES = ((1440, 900), (1920, 1080))
SCHEMES = ("dark", "light")


def walk(
    playwright: Playwright, folder: Path, size: tuple[int, int], scheme: str, browser: str | None
) -> list[str]:
    """Walk the way once on a stage of its own; return what was wrong."""
    found, axe = [], Axe()
    with staged("--closed", "--confirm") as stage:
        launched = playwright.chromium.launch(executable_path=browser, args=ARGUMENTS)
        page = launched.new_page(
            viewport={"width": size[0], "height": size[1]},
            color_scheme="light" if scheme == "light" else "dark",
        )
        page.set_default_timeout(TIMEOUT_MS)
        trouble = listen(page, stage.address)
        for number, step in enumerate(Walk(page, stage.address + stage.link).steps(), start=1):
            name = f"{size[0]}-{scheme}-{number:02d}-{step}"
            page.screenshot(path=folder / f"{name}.png")
            sys.stdout.write(f"{name}\n")
            found += [f"{name}: overlap: {each}" for each in page.evaluate(OVERLAPS)]
            found += [f"{name}: cut: {each}" for each in page.evaluate(CUT)]
            found += [f"{name}: faint: {each}" for each in faint_texts(page, axe)]
        found += [f"{size[0]}-{scheme}: {each}" for each in trouble]
        launched.close()
    return found


def main() -> int:
    """Walk it in every size and scheme."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--browser", help="path of a Chromium; Playwright's own if left out")
    parser.add_argument("--only", help="one size and scheme, such as 1440-dark")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    found: list[str] = []
    with sync_playwright() as playwright:
        for size in SIZES:
            for scheme in SCHEMES:
                if options.only in (None, f"{size[0]}-{scheme}"):
                    found += walk(playwright, options.folder, size, scheme, options.browser)
    sys.stdout.write("\n".join([*found, f"{len(found)} found"]) + "\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
