"""`make help`, the pages and `--help` tell the same story."""

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from server.cli import app
from tests.house.documents import CODE, MAKE, documents, sections
from tests.house.inventory import commands

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "reference" / "cli.md"
ROW = re.compile(r"^\| `([^`]+)`(?:[^|]*)\| (.*) \|$", re.MULTILINE)
SAME = re.compile(r"\b[Aa]s (for|above)\b|\bThe same\b|^As `")


def _make(*arguments: str) -> str:
    done = subprocess.run(
        ["make", "--no-print-directory", *arguments],
        cwd=ROOT,
        env={name: value for name, value in os.environ.items() if name != "PYTEST_ARGS"},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def _targets() -> dict[str, str]:
    """Return what `make help` says of each target."""
    return dict(re.findall(r"^  make ([a-z-]+) +(.+)$", _make("help"), re.MULTILINE))


def _documented() -> dict[str, str]:
    section = sections(PAGE.read_text("utf-8"), 2)["Make targets"]
    return {name.removeprefix("make "): text for name, text in ROW.findall(section)}


def test_the_page_lists_what_make_help_lists() -> None:
    targets = _targets()
    assert len(targets) > 10
    assert _documented() == {name: text.replace("|", "\\|") for name, text in targets.items()}


def test_pages_speak_of_targets_that_make_help_lists() -> None:
    for page in documents(ROOT):
        code = re.findall(r"`[^`]+`|```.*?```", page.read_text("utf-8"), re.DOTALL)
        spoken = {target for each in code for target in MAKE.findall(each)}
        assert spoken <= set(_targets()), page


def test_make_run_does_what_the_first_page_says() -> None:
    assert _make("-n", "run").strip().endswith("exec .venv/bin/falconer run demo --port 8000")
    assert "falconer run hardware --port 8123" in _make(
        "-n", "run", "SCENARIO=hardware", "PORT=8123"
    )
    assert _make("-n", "test").strip().endswith("pytest --numprocesses 2")
    assert _make("-n", "test", "PYTEST_ARGS=-x").strip().endswith("--numprocesses 2 -x")


# ------------------------------------------------------------------------- --help


def test_help_lists_the_commands_of_the_page() -> None:
    said = CliRunner().invoke(app, ["--help"], terminal_width=200).output
    for name in commands(app):
        assert re.search(rf"\b{name.split()[0]}\b", said), name


@pytest.mark.parametrize("name", sorted(commands(app)))
def test_help_and_page_agree(name: str) -> None:
    """Of each option: that there is one, what it may be, what it is when left out."""
    section = sections(PAGE.read_text("utf-8"), 2)[f"`falconer {name}`"]
    rows = dict(ROW.findall(section.split("\n### ")[0]))
    said = CliRunner().invoke(app, [*name.split(), "--help"], terminal_width=400).output
    for parameter in commands(app)[name].params:
        if parameter.name == "help" or parameter.param_type_name == "argument":
            continue
        option = max(parameter.opts, key=len)
        row = rows[option]
        assert option in said
        if not SAME.search(row):
            spoken = {word for code in CODE.findall(row) for word in code.split()}
            assert _choices(parameter) <= spoken, f"{option}: {row}"
            assert _default(parameter) in row, f"{option}: {row}"


def _choices(parameter: Any) -> set[str]:
    values = getattr(parameter.type_descriptor.annotation, "__members__", {})
    return {str(each.value) for each in values.values()}


def _default(parameter: Any) -> str:
    """Return what stands for an option that is left out, empty for nothing."""
    default = parameter.default
    if default is None or parameter.is_flag or callable(default) or default in ((), []):
        return ""
    plain = getattr(default, "value", default)
    return f"{plain:g}" if isinstance(plain, int | float) else str(plain)
