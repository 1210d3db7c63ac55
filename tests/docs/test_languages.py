"""Every block of README and docs/ that is no command: run, or read by what it is meant for."""

import configparser
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
import zenoh

from server.api.alarm_models import Alarm
from server.api.models import ErrorAnswer
from server.cli import app
from server.cli.vehicle_options import TagFile, tags_of
from server.scenarios.schema import Scenario
from server.scripts.script import load_script
from server.settings import Settings
from tests.docs.blocks import Block, blocks
from tests.docs.rules import LANGUAGES
from tests.house.inventory import parse

ROOT = Path(__file__).resolve().parents[2]
BLOCKS = [block for block in blocks(ROOT) if block.language != "sh"]
ELSEWHERE = {
    "docs/guides/vehicles.md": "tests/vehicles/test_docs.py",
    "docs/localization.md": "tests/vehicles/localization/test_docs.py",
}
"""Pages whose Python is run by a test that also looks at what it does."""

UNIT_SECTIONS = {"Unit", "Service", "Install", "Timer", "Socket", "Path"}


def _python(block: Block, folder: Path) -> None:
    if elsewhere := ELSEWHERE.get(block.page):
        assert Path(block.page).name in (ROOT / elsewhere).read_text("utf-8")
        return
    done = subprocess.run(
        [sys.executable, "-c", block.text],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def _yaml(block: Block, folder: Path) -> None:
    file = folder / "block.yaml"
    file.write_text(block.text, "utf-8")
    content = yaml.safe_load(block.text)
    if "tags" in content:
        assert tags_of(file) == TagFile.model_validate(content)
    elif "actions" in content:
        assert load_script(file).name == content["name"]
    elif "services" in content:
        for service in content["services"].values():
            parse(app, list(service["command"]))
    elif "name" in content:
        assert Scenario.model_validate(content).name == content["name"]
    else:  # parts of a scenario: of the page's first
        first = next(each for each in BLOCKS if each.page == block.page and each.language == "yaml")
        Scenario.model_validate(yaml.safe_load(first.text) | content)


def _json(block: Block, folder: Path) -> None:
    """An answer of ours, every field of it."""
    content = json.loads(block.text)
    model = ErrorAnswer if "error" in content else Alarm
    assert model.model_validate(content).model_dump(mode="json") == content


def _json5(block: Block, folder: Path) -> None:
    """A configuration of the bus."""
    zenoh.Config.from_json5(block.text)


def _ini(block: Block, folder: Path) -> None:
    """Settings, or a unit of systemd."""
    if re.match(r"(#.*\n|\s)*\[", block.text):
        unit = configparser.RawConfigParser(strict=False)
        unit.read_string(block.text)
        assert set(unit.sections()) <= UNIT_SECTIONS
        return
    with pytest.MonkeyPatch.context() as environment:
        for line in block.text.splitlines():
            name, _, value = line.partition("=")
            if name and not name.startswith("#"):
                environment.setenv(name, value)
                assert name.removeprefix("FALCONER_").lower() in Settings.model_fields
        Settings()


def _toml(block: Block, folder: Path) -> None:
    """The file of settings."""
    Settings.model_validate(tomllib.loads(block.text))


def _text(block: Block, folder: Path) -> None:
    """A drawing, an equation or what a program says; no command hides in it."""
    assert not re.search(r"^\s*(\$ |falconer |curl |make |python )", block.text, re.MULTILINE)


def _braces(block: Block, folder: Path) -> None:
    """Of other programs, which are not ours to install: that its braces close."""
    depths = [0]
    for character in re.sub(r"#.*", "", block.text):
        depths.append(depths[-1] + {"{": 1, "}": -1}.get(character, 0))
    assert min(depths) == 0 == depths[-1]


CHECKS: dict[str, Callable[[Block, Path], None]] = {
    "caddyfile": _braces,
    "conf": _braces,
    "ini": _ini,
    "json": _json,
    "json5": _json5,
    "nginx": _braces,
    "python": _python,
    "systemd": _ini,
    "text": _text,
    "toml": _toml,
    "yaml": _yaml,
}


@pytest.mark.process
@pytest.mark.timeout(300)
@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.name)
def test_a_block_is_what_it_is_meant_for(block: Block, tmp_path: Path) -> None:
    CHECKS[block.language](block, tmp_path)


def test_every_language_has_its_check() -> None:
    assert set(CHECKS) == set(LANGUAGES)
