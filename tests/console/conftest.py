"""What a page shall show may be long in coming: Playwright's own five seconds are too few."""

from playwright.sync_api import expect

from tests.console.flow import TIMEOUT_MS

expect.set_options(timeout=TIMEOUT_MS)
