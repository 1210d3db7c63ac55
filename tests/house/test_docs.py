"""The documentation names what exists, all of it and nothing else."""

import re
from pathlib import Path

import pytest

from server.cli import app
from server.settings import Settings
from tests.house.documents import (
    ADDRESS,
    CODE,
    MAKE,
    ROUTE,
    SETTING,
    Route,
    anchors,
    command_lines,
    documents,
    first_cells,
    links,
    sections,
)
from tests.house.inventory import (
    UnparsableError,
    commands,
    parameters,
    parse,
    routes,
    settings,
)
from tests.house.sources import PACKAGES, python_files

ROOT = Path(__file__).resolve().parent.parent.parent
PAGES = documents(ROOT)
REFERENCE = ROOT / "docs" / "reference"


def _text(page: Path) -> str:
    return page.read_text("utf-8")


def _name(page: Path) -> str:
    return str(page.relative_to(ROOT))


# ------------------------------------------------------------------------- commands


def test_every_command_is_documented_and_exists() -> None:
    headings = sections(_text(REFERENCE / "cli.md"), 2)
    documented = {match[1] for title in headings if (match := re.match(r"`falconer (.+)`", title))}
    assert documented == set(commands(app))


@pytest.mark.parametrize("name", sorted(commands(app)))
def test_every_option_is_documented_and_exists(name: str) -> None:
    section = sections(_text(REFERENCE / "cli.md"), 2)[f"`falconer {name}`"]
    options = section.split("\n### ")[0]
    spans = [CODE.findall(cell) for cell in first_cells(options)]
    documented = {span.split()[0] for cell in spans for span in cell}
    assert documented == parameters(commands(app)[name])


def _documented_lines() -> list[tuple[str, list[str]]]:
    return [(_name(page), line) for page in PAGES for line in command_lines(_text(page))]


@pytest.mark.parametrize(
    ("page", "line"),
    _documented_lines(),
    ids=lambda value: value if isinstance(value, str) else " ".join(value),
)
def test_every_documented_command_line_can_be_parsed(page: str, line: list[str]) -> None:
    if " ".join(line) in commands(app):
        return  # a command spoken of by its name alone
    parse(app, line)


@pytest.mark.parametrize("line", [["fly"], ["run", "demo", "--no-such-option"], ["run", "a", "b"]])
def test_a_wrong_command_line_is_noticed(line: list[str]) -> None:
    with pytest.raises(UnparsableError):
        parse(app, line)


# ------------------------------------------------------------------------- settings


def test_every_setting_is_documented() -> None:
    cells = first_cells(_text(REFERENCE / "settings.md"))
    documented = [name for cell in cells for name in SETTING.findall(cell)]
    assert sorted(documented) == sorted(settings(Settings))


def test_every_default_is_documented() -> None:
    text = _text(REFERENCE / "settings.md")
    documented = re.findall(r"^\| `(FALCONER_\w+)` \| `([^`]+)` \|", text, re.MULTILINE)
    fields = zip(settings(Settings), Settings.model_fields.values(), strict=True)
    assert dict(documented) == {
        name: str(field.default) for name, field in fields if field.default is not None
    }


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_setting_spoken_of_exists(page: Path) -> None:
    assert set(SETTING.findall(_text(page))) - set(settings(Settings)) == set()


def test_every_variable_that_the_code_speaks_of_is_a_setting() -> None:
    spoken = {
        name
        for file in python_files(ROOT, PACKAGES)
        for name in SETTING.findall(_text(file))
        if not name.endswith("_")
    }
    assert spoken - set(settings(Settings)) == set()


# --------------------------------------------------------------------------- routes


def test_every_route_is_documented_and_exists() -> None:
    documented = {Route(*found) for found in ROUTE.findall(_text(REFERENCE / "api.md"))}
    assert documented == routes()


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_address_spoken_of_exists(page: Path) -> None:
    patterns = [re.sub(r"\{\w+\}", r"[^/]+", route.path) for route in routes()]
    for address in ADDRESS.findall(_text(page)):
        path = address.rstrip("./")
        known = any(re.fullmatch(pattern, path) for pattern in patterns)
        prefix = any(route.path.startswith(f"{path}/") for route in routes())
        assert known or prefix, f"{_name(page)}: {address}"


# ------------------------------------------------------------------- links and targets


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_link_leads_somewhere(page: Path) -> None:
    for link in links(_text(page)):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f"{_name(page)}: {link}"
        if anchor:
            assert anchor in anchors(_text(target)), f"{_name(page)}: {link}"


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_make_target_spoken_of_exists(page: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", _text(ROOT / "Makefile"), re.MULTILINE))
    spoken = {
        target
        for code in re.findall(r"`[^`]+`|```.*?```", _text(page), re.DOTALL)
        for target in MAKE.findall(code)
    }
    assert spoken - targets == set()


def test_every_page_can_be_reached() -> None:
    reached = {ROOT / "README.md"}
    waiting = list(reached)
    while waiting:
        page = waiting.pop()
        for link in links(_text(page)):
            target = (page.parent / link.partition("#")[0]).resolve()
            if target.suffix == ".md" and target not in reached:
                reached.add(target)
                waiting.append(target)
    assert set(PAGES) - reached == set(), "no other page links to these"
