"""Imports go down the floors only, and the check that says so can fail."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

PACKAGES = ("solver", "llm", "vehicles", "server", "console")


def _check_floors(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run import-linter on the packages of a folder, with that folder's own contracts."""
    command = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    return subprocess.run(
        [sys.executable, "-c", command, "--no-logo", "--no-cache"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )


@pytest.fixture
def house(root: Path, tmp_path: Path) -> Path:
    """Return a copy of the floors that a test may spoil."""
    for package in PACKAGES:
        shutil.copytree(root / package, tmp_path / package, ignore=shutil.ignore_patterns("__py*"))
    shutil.copy(root / "pyproject.toml", tmp_path)
    return tmp_path


def test_imports_go_down_only(root: Path) -> None:
    checked = _check_floors(root)
    assert checked.returncode == 0, checked.stdout + checked.stderr


@pytest.mark.parametrize(
    ("module", "forbidden"),
    [
        ("solver/planted.py", "server"),
        ("llm/planted.py", "vehicles"),
        ("vehicles/planted.py", "llm"),
        ("vehicles/planted.py", "server"),
        ("server/planted.py", "console"),
        ("solver/planted.py", "httpx"),
        ("llm/planted.py", "zenoh"),
        ("vehicles/planted.py", "fastapi"),
    ],
)
def test_an_import_that_goes_up_is_found(house: Path, module: str, forbidden: str) -> None:
    (house / module).write_text(f"import {forbidden}\n")
    checked = _check_floors(house)
    assert checked.returncode == 1, checked.stdout + checked.stderr
    planted = module.removesuffix(".py").replace("/", ".")
    assert f"{planted} -> {forbidden}" in checked.stdout, checked.stdout
