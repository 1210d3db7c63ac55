"""A new operator's whole way through the console, one step after another.

`test_flow` walks it; `tests.console.screenshots` walks it and takes a picture of every step.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from playwright.sync_api import Locator, Page, expect

TIMEOUT_MS = 60_000
FOCUS = "The Drone 21 should focus on tracking target 122."

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


@dataclass(frozen=True)
class Walk:
    """One browser window on a mission under the gate `confirm`."""

    page: Page
    link: str
    """The address that opens it."""

    def steps(self) -> Iterator[str]:
        """Do one thing after another, each seen to have worked; yields what was done."""
        for step in (
            self._open,
            self._comment,
            self._approve,
            self._refuse,
            self._pin,
            self._draw,
            self._hold,
            self._resume,
            self._scrub,
            self._return,
            self._evidence,
            self._alarms,
            self._events,
            self._library,
        ):
            step()
            yield step.__name__.removeprefix("_")

    # ------------------------------------------------------------------ the steps

    def _open(self) -> None:
        self.page.goto(self.link)
        expect(self.page.locator(".team tbody tr")).to_have_count(4, timeout=TIMEOUT_MS)
        self.page.wait_for_function(MANY_COLOURS, timeout=TIMEOUT_MS)
        clock = self.page.locator(".clock")
        expect(clock).not_to_have_text(clock.inner_text(), timeout=TIMEOUT_MS)

    def _comment(self) -> None:
        self._say(FOCUS)
        self._shown(".waiting .what", "Drone 21: target 122 instead of 125.")
        self._shown(".waiting .prediction", "-0.142 m²")
        self._shown(".receipt.received", FOCUS)

    def _approve(self) -> None:
        self._tap("[data-tap^='approve:']")
        self._shown(".receipt.applied", "Robot 21 takes target 122")
        cell = self.page.locator("[data-tap='pair:21:122'][aria-label*='assigned']")
        expect(cell).to_have_count(1, timeout=TIMEOUT_MS)
        expect(self.page.locator(".waiting")).to_have_count(0, timeout=TIMEOUT_MS)

    def _refuse(self) -> None:
        self._say("Track more boldly.")
        self._shown(".waiting header", "s left")
        self.page.keyboard.press("x")
        self.page.keyboard.press("Enter")
        self._shown(".receipt.declined", "refused it.")

    def _pin(self) -> None:
        self._tap("[data-tap='pair:34:124']")
        pinned = self.page.locator("[data-tap='pair:34:124'][aria-label*='pinned']")
        expect(pinned).to_have_count(1, timeout=TIMEOUT_MS)

    def _draw(self) -> None:
        self._tap("[data-draw=start]")
        for name, value in (("x", "-4"), ("y", "-2"), ("long", "1.5"), ("short", "1")):
            self.page.locator(f"[data-field=zone-{name}]").fill(value)
        self._tap("[data-draw=confirm]")
        self._tap("#limits-tab-1")
        self._shown("[data-zone=h1]", "h1")

    def _hold(self) -> None:
        self.page.keyboard.press("Space")
        self._shown(".mission .chip", "held")

    def _resume(self) -> None:
        self.page.wait_for_function("!falconer.typedLately()")
        self.page.keyboard.press("r")
        self._shown(".mission .chip", "running")

    def _scrub(self) -> None:
        self.page.keyboard.press(",")
        self._shown(".look-banner", "Looking")

    def _return(self) -> None:
        self.page.keyboard.press("l")
        expect(self.page.locator(".look-banner")).to_have_count(0, timeout=TIMEOUT_MS)

    def _evidence(self) -> None:
        self._tap(".receipt.applied [data-reveal]")  # leads to its card
        card = self.page.locator(".decision.applied", has_text="instead of 125").last
        expect(card).to_be_visible(timeout=TIMEOUT_MS)
        expect(card).to_contain_text("Approved by")
        card.locator("summary", has_text="Evidence").click()
        expect(card.get_by_text("Robot 26 is blind.")).to_be_visible(timeout=TIMEOUT_MS)
        card.locator("summary", has_text="Prompt").click()
        answer = card.get_by_text("Drone 21 should track Target 121 and Target 122.")
        expect(answer).to_be_visible(timeout=TIMEOUT_MS)
        expect(card.get_by_text("<script>alert('prompt')</script>")).to_be_visible()

    def _alarms(self) -> None:
        expect(self.page.locator(".alarm-lamp .lamp.warn")).to_have_count(1, timeout=TIMEOUT_MS)
        self._tap(".alarm-lamp button")
        self._shown(".alarm.warning", "Robot 31 is cut off")
        self._tap("[data-tap='ack:link-31']")
        self._shown(".alarm.known", "operator")
        expect(self.page.locator(".alarm-lamp .lamp.calm")).to_have_count(1, timeout=TIMEOUT_MS)

    def _events(self) -> None:
        self.page.keyboard.press("4")
        event = self.page.locator(".events", has_text="acknowledged: Robot 31 is cut off.")
        expect(event).to_be_visible(timeout=TIMEOUT_MS)

    def _library(self) -> None:
        self.page.keyboard.press("5")
        expect(self.page.locator("#aside-page-4")).to_be_visible(timeout=TIMEOUT_MS)

    # ------------------------------------------------------------------ the hand

    def _say(self, words: str) -> None:
        self.page.keyboard.press("/")
        self.page.fill(".comment-box", words)
        self.page.press(".comment-box", "Enter")

    def _tap(self, selector: str) -> None:
        self.page.locator(selector).first.click(timeout=TIMEOUT_MS)

    def _shown(self, selector: str, words: str) -> Locator:
        found = self.page.locator(selector, has_text=words).first
        expect(found).to_be_visible(timeout=TIMEOUT_MS)
        return found


def listen(page: Page, address: str) -> list[str]:
    """Return a list that errors on the console and requests to elsewhere are added to."""
    trouble: list[str] = []
    own = (address, address.replace("http", "ws"), "data:", "blob:")
    add: Callable[[str], None] = trouble.append
    page.on("console", lambda said: add(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: add(str(error)))
    page.on(
        "request",
        lambda asked: None if asked.url.startswith(own) else add(f"request to {asked.url}"),
    )
    return trouble
