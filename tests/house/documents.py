"""Reads the documentation: its headings, tables, links, commands, settings and routes."""

import re
import shlex
from pathlib import Path
from typing import NamedTuple

CODE = re.compile(r"`([^`\n]+)`")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
HEADING = re.compile(r"^(#+) +(.+?) *$", re.MULTILINE)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
SETTING = re.compile(r"\bFALCONER_[A-Z0-9_]+\b")
ROUTE = re.compile(r"`(GET|POST|PUT|PATCH|DELETE|WS) (/[^`\s]*)`")
ADDRESS = re.compile(r"(?<![\w.])(/api/v\d[\w/{}.-]*)")
COMMAND = re.compile(r"^(?:\$ +)?(?:\.venv/bin/)?falconer(?: +(.*))?$")
MAKE = re.compile(r"\bmake +([a-z][a-z-]*)\b")


class Route(NamedTuple):
    """One way into the server; the method of a WebSocket is `WS`."""

    method: str
    path: str


def documents(root: Path) -> list[Path]:
    """Return the README and every page below `docs/`."""
    return [root / "README.md", *sorted((root / "docs").rglob("*.md"))]


def sections(text: str, level: int) -> dict[str, str]:
    """Return the text below each heading of a level, up to the next heading of that level or up."""
    found: dict[str, str] = {}
    title = None
    start = 0
    for match in HEADING.finditer(_without_fences(text)):
        if len(match[1]) > level:
            continue
        if title is not None:
            found[title] = text[start : match.start()]
        title = match[2] if len(match[1]) == level else None
        start = match.end()
    if title is not None:
        found[title] = text[start:]
    return found


def first_cells(text: str) -> list[str]:
    """Return the first cell of every row of every table, headers left out."""
    rows = re.findall(r"^\|(.*)\| *$", text, re.MULTILINE)
    cells = [re.split(r"(?<!\\)\|", row)[0].strip() for row in rows]
    rules = [i for i, cell in enumerate(cells) if re.fullmatch(r":?-+:?", cell)]
    headers = {i - 1 for i in rules}
    return [cell for i, cell in enumerate(cells) if i not in headers and i not in rules]


def anchors(text: str) -> set[str]:
    """Return the anchors that a page's headings make, as code hosts derive them."""
    plain = (re.sub(r"[^\w\- ]", "", match[2].lower()) for match in HEADING.finditer(text))
    return {title.replace(" ", "-") for title in plain}


def links(text: str) -> list[str]:
    """Return the targets of a page's links to other places of the project."""
    found = (match[1] for match in LINK.finditer(_without_fences(text)))
    return [target for target in found if not re.match(r"[a-z]+:", target)]


def command_lines(text: str) -> list[list[str]]:
    """Return the arguments of every `falconer` command in fenced blocks and code spans."""
    lines = [
        line.strip()
        for fence in FENCE.finditer(text)
        for line in fence[2].replace("\\\n", " ").splitlines()
    ]
    lines += CODE.findall(_without_fences(text))
    found = (COMMAND.match(line) for line in lines)
    return [shlex.split(match[1] or "", comments=True) for match in found if match]


def _without_fences(text: str) -> str:
    """Blank out fenced blocks, keeping every position."""
    return FENCE.sub(lambda fence: re.sub(r"[^\n]", " ", fence[0]), text)
