"""The Makefile explains itself, and its scripts cope with machines that lack something."""

import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from server.cli import app
from tests.house.inventory import parse
from tests.patience import PATIENCE_S


def _run(
    arguments: list[str | Path], folder: Path, path: Path | None = None
) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": str(path)} if path else None
    return subprocess.run(
        arguments, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def _program(folder: Path, name: str, script: str) -> None:
    """Put a program of ours into a folder that stands for the whole PATH."""
    file = folder / name
    file.write_text(f"#!/bin/sh\n{script}\n")
    file.chmod(0o755)


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """Return a PATH with next to nothing on it."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in ("cat", "id", "sh"):
        found = shutil.which(name)
        assert found is not None
        (folder / name).symlink_to(found)
    return folder


# --------------------------------------------------------------------------- Makefile


def test_make_alone_lists_every_target(root: Path) -> None:
    listed = _run(["make"], root)
    assert listed.returncode == 0, listed.stderr
    makefile = (root / "Makefile").read_text("utf-8")
    phony = re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert phony is not None
    shown = set(re.findall(r"^  make ([a-z-]+) +\S", listed.stdout, re.MULTILINE))
    assert shown == set(phony[1].split()) - {"setup-dev"}


def test_a_changed_lock_renews_the_installation(root: Path, tmp_path: Path) -> None:
    ages = itertools.count(1000, -10)  # seconds ago: clocks of file systems are coarse

    def made(file: Path) -> None:
        file.touch()
        when = time.time() - next(ages)
        os.utime(file, (when, when))

    for file in (root / "Makefile", root / "pyproject.toml", *root.glob("requirements*.lock")):
        made(Path(shutil.copy(file, tmp_path)))
    stamps = tmp_path / ".venv"
    (stamps / "bin").mkdir(parents=True)
    for name in ("bin/python", ".packages", ".setup", ".setup-dev", ".setup-local"):
        made(stamps / name)
    assert _run(["make", "-q", "setup", "setup-dev", "setup-local"], tmp_path).returncode == 0
    made(tmp_path / "requirements-local.lock")
    assert _run(["make", "-q", "setup", "setup-dev"], tmp_path).returncode == 0
    assert _run(["make", "-q", "setup-local"], tmp_path).returncode == 1
    made(tmp_path / "requirements-dev.lock")
    assert _run(["make", "-q", "setup"], tmp_path).returncode == 0
    assert _run(["make", "-q", "setup-dev"], tmp_path).returncode == 1
    made(tmp_path / "requirements.lock")
    assert _run(["make", "-q", "setup"], tmp_path).returncode == 1


# ---------------------------------------------------------------------- scripts/python


def test_the_first_python_that_works_is_taken(root: Path, bare: Path) -> None:
    _program(bare, "python3.13", "echo 'no such version installed' >&2; exit 127")
    _program(bare, "python3.11", f'exec {sys.executable} "$@"')
    found = _run([root / "scripts" / "python"], root, bare)
    assert found.stdout.strip() == str(bare / "python3.11")
    assert found.stderr == ""


def test_a_python_without_venv_is_passed_over(root: Path, bare: Path) -> None:
    hide = "import sys; sys.modules['ensurepip'] = None"
    _program(bare, "python3.12", f'exec {sys.executable} -c "{hide}; $2"')
    _program(bare, "python3", f'exec {sys.executable} "$@"')
    assert _run([bare / "python3.12", "-c", "print(7)"], root, bare).stdout == "7\n"
    assert _run([root / "scripts" / "python"], root, bare).stdout.strip() == str(bare / "python3")


def test_no_python_at_all_is_told_in_words(root: Path, bare: Path) -> None:
    _program(bare, "python3", "exit 1")
    found = _run([root / "scripts" / "python"], root, bare)
    assert found.returncode == 1
    assert found.stdout == ""
    assert "Python 3.11 or newer" in found.stderr


# --------------------------------------------------------------------- scripts/browser


def test_an_installed_browser_is_enough(root: Path, bare: Path) -> None:
    _program(bare, "chromium", "exit 0")
    assert _run([root / "scripts" / "browser", bare], root, bare).stdout == ""


def test_without_apt_playwright_downloads_a_browser(root: Path, bare: Path) -> None:
    _program(bare, "playwright", 'echo "playwright $*"')
    found = _run([root / "scripts" / "browser", bare], root, bare)
    assert found.returncode == 0, found.stderr
    assert "playwright install chromium" in found.stdout


def test_apt_is_asked_first_where_it_may_install(root: Path, bare: Path) -> None:
    (bare / "id").unlink()
    _program(bare, "id", "echo 0")
    _program(bare, "apt-get", 'echo "apt-get $*" >&2')
    found = _run([root / "scripts" / "browser", bare], root, bare)
    assert found.returncode == 0, found.stderr
    assert "install -y -qq --no-install-recommends chromium" in found.stderr


def test_no_browser_to_be_had_is_told_in_words(root: Path, bare: Path) -> None:
    _program(bare, "playwright", "exit 1")
    found = _run([root / "scripts" / "browser", bare], root, bare)
    assert found.returncode == 1
    assert "apt-get install chromium" in found.stderr


# ----------------------------------------------------------------------- scripts/mixed


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_the_mixed_team_is_started_and_ended_as_one(
    root: Path, tmp_path: Path, number: signal.Signals, code: int
) -> None:
    said, pids = tmp_path / "said", tmp_path / "pids"
    _program(tmp_path, "falconer", f'echo "$*" >> {said}; echo $$ >> {pids}; exec sleep 60')
    script = subprocess.Popen([root / "scripts" / "mixed", tmp_path, "8123"], cwd=root)
    try:
        _until(lambda: pids.exists() and len(pids.read_text().splitlines()) == 6)
        script.send_signal(number)
        assert script.wait(timeout=PATIENCE_S) == code
    finally:
        script.kill()
    for pid in pids.read_text().split():
        assert not Path(f"/proc/{pid}").exists(), "nothing outlives it"
    lines = [line.split() for line in said.read_text().splitlines()]
    for line in lines:
        parse(app, line)
    assert sorted(line[0] for line in lines) == ["serve", "sim", *["vehicle"] * 4]


def test_the_mixed_team_ends_with_its_server(root: Path, tmp_path: Path) -> None:
    _program(tmp_path, "falconer", '[ "$1" = serve ] && exit 2; exec sleep 60')
    done = subprocess.run(
        [root / "scripts" / "mixed", tmp_path], cwd=root, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 2


def _until(condition: Callable[[], bool]) -> None:
    for _ in range(round(PATIENCE_S / 0.02)):
        if condition():
            return
        time.sleep(0.02)
    raise AssertionError("did not happen")
