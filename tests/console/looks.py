"""What is measured of a page's looks: overlaps, cut text, contrast."""

from typing import Any, Final

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

ARGUMENTS: Final = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]
"""Chromium without a display or a graphics card."""

OVERLAPS: Final = """
() => {
  const cards = [...document.querySelectorAll(".console > .bar, .stage, .card")];
  const boxes = cards.map((card) => [card.className, card.getBoundingClientRect()]);
  const found = [];
  for (const [i, [a, p]] of boxes.entries()) {
    const scrolls = innerWidth <= 1360;  // below that the page goes on below the window
    if (p.left < 0 || p.top < 0 || p.right > innerWidth + 1 ||
        (!scrolls && p.bottom > innerHeight + 1))
      found.push(`${a} leaves the window`);
    for (const [b, q] of boxes.slice(i + 1)) {
      const beside = p.left > q.right - 1 || q.left > p.right - 1;
      const above = p.top > q.bottom - 1 || q.top > p.bottom - 1;
      if (!beside && !above) found.push(`${a} overlaps ${b}`);
    }
  }
  const bar = [...document.querySelectorAll(".bar > *")].map((e) => e.getBoundingClientRect());
  const shown = bar.filter((p) => p.width);
  for (const [i, p] of shown.entries())
    for (const q of shown.slice(i + 1))
      if (p.left < q.right - 1 && q.left < p.right - 1 &&
          p.top < q.bottom - 1 && q.top < p.bottom - 1) found.push(`bar item ${i} overlaps`);
  return found;
}
"""

CUT: Final = """
() => {
  const found = [];
  for (const element of document.querySelectorAll(".console *")) {
    if (element.offsetParent === null) continue;
    if (element.closest("svg, textarea, .q-field, .exchange")) continue;
    const own = [...element.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    if (!own) continue;
    const words = element.textContent.trim().slice(0, 60);
    const style = getComputedStyle(element);
    const clips = style.overflowX !== "visible" && style.overflowX !== "auto";
    if (clips && element.scrollWidth > element.clientWidth + 1)
      found.push(`${element.className || element.tagName}: ${words}`);
    const box = element.getBoundingClientRect();
    const card = element.closest(".bar, .card, .stage")?.getBoundingClientRect();
    if (card && box.width && (box.right > card.right + 1 || box.left < card.left - 1))
      found.push(`leaves its card: ${words}`);
  }
  return [...new Set(found)];
}
"""
"""Texts that are wider than what shows of them."""


STILL: Final = "*, ::before, ::after { transition: none !important; animation: none !important; }"
"""Whatever changes its colour, or comes and goes, has done so at once."""


def faint_texts(page: Page, axe: Axe) -> list[str]:
    """Return the texts of a page whose contrast is below 4.5 to 1 (3 to 1 for large ones)."""
    page.add_style_tag(content=STILL)
    only = {"runOnly": {"type": "rule", "values": ["color-contrast"]}, "iframes": False}
    answer: dict[str, Any] = axe.run(page, options=only).response
    return [
        f"{node['target']}: {node['any'][0]['message'] if node['any'] else node['html'][:80]}"
        for violation in answer["violations"]
        for node in violation["nodes"]
    ]
