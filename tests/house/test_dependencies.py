"""What is imported is declared, what is declared is used, and what is used is locked."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.house.sources import CHECKS, PACKAGES, imported_names, python_files

USED_WITHOUT_IMPORT = {"aiosqlite": "SQLAlchemy's driver of SQLite"}
"""Runtime dependencies that no module of ours names, and who uses them."""

TOOLS = {
    "import-linter": "make floors",
    "mutmut": "make mutants",
    "mypy": "make lint",
    "pytest-asyncio": "plug-in of pytest",
    "pytest-rerunfailures": "plug-in of pytest",
    "pytest-xdist": "plug-in of pytest",
    "pytest-timeout": "plug-in of pytest",
    "ruff": "make lint",
    "schemathesis": "benchmarks.fuzz runs its command",
    "types-pyyaml": "stubs for mypy",
    "uv": "make lock",
}
"""Development dependencies that are run, not imported."""

LOCKS = ("requirements.lock", "requirements-dev.lock", "requirements-local.lock")
PIN = re.compile(r"^([a-z0-9][a-z0-9.-]*)==(\S+)", re.MULTILINE)


@pytest.fixture(scope="session")
def project(root: Path) -> dict[str, Any]:
    return tomllib.loads((root / "pyproject.toml").read_text("utf-8"))


def _declared(requirements: list[str]) -> set[str]:
    return {canonicalize_name(Requirement(line).name) for line in requirements}


def _imported(root: Path, folders: tuple[str, ...]) -> set[str]:
    """Return the distributions that the modules of some folders import."""
    providers = packages_distributions()
    own = {*PACKAGES, *CHECKS}
    found: set[str] = set()
    for file in python_files(root, folders):
        names = imported_names(ast.parse(file.read_text("utf-8")))
        for name in names - own - sys.stdlib_module_names:
            assert name in providers, f"{file.relative_to(root)} imports {name}: not installed"
            found.update(canonicalize_name(provider) for provider in providers[name])
    return found


def _pins(lock: Path) -> dict[str, str]:
    return dict(PIN.findall(lock.read_text("utf-8")))


def test_every_import_of_the_product_is_declared(root: Path, project: dict[str, Any]) -> None:
    extras = project["project"]["optional-dependencies"]
    declared = _declared(project["project"]["dependencies"])
    for name, requirements in extras.items():
        if name != "dev":
            declared |= _declared(requirements)
    assert _imported(root, PACKAGES) - declared == set()


def test_every_import_of_the_tests_is_declared(root: Path, project: dict[str, Any]) -> None:
    declared = _declared(
        project["project"]["dependencies"] + project["project"]["optional-dependencies"]["dev"]
    )
    assert _imported(root, CHECKS) - declared == set()


def test_every_runtime_dependency_is_used(root: Path, project: dict[str, Any]) -> None:
    declared = _declared(project["project"]["dependencies"])
    used = _imported(root, PACKAGES) | set(USED_WITHOUT_IMPORT)
    assert declared - used == set(), "nobody imports these"


def test_every_development_dependency_is_used(root: Path, project: dict[str, Any]) -> None:
    declared = _declared(project["project"]["optional-dependencies"]["dev"])
    assert declared - _imported(root, CHECKS) - set(TOOLS) == set(), "nobody uses these"


def test_every_dependency_says_what_it_is_for(root: Path, project: dict[str, Any]) -> None:
    lines = (root / "pyproject.toml").read_text("utf-8").splitlines()
    extras = project["project"]["optional-dependencies"]
    for requirement in project["project"]["dependencies"] + extras["dev"]:
        (line,) = [line for line in lines if line.startswith(f'    "{requirement}",')]
        assert len(line.partition(" # ")[2].split()) >= 2, f"{requirement}: what for?"


def test_the_exceptions_are_exceptions(root: Path, project: dict[str, Any]) -> None:
    assert set(USED_WITHOUT_IMPORT) <= _declared(project["project"]["dependencies"])
    assert not set(USED_WITHOUT_IMPORT) & _imported(root, PACKAGES)
    assert set(TOOLS) <= _declared(project["project"]["optional-dependencies"]["dev"])


def test_the_build_backend_is_locked(root: Path, project: dict[str, Any]) -> None:
    locked = project["dependency-groups"]["build"]
    assert set(project["build-system"]["requires"]) <= set(locked)
    assert _declared(locked) <= set(_pins(root / "requirements.lock"))


@pytest.mark.parametrize("lock", ["requirements.lock", "requirements-dev.lock"])
def test_a_lock_holds_what_is_declared(root: Path, project: dict[str, Any], lock: str) -> None:
    requirements = list(project["project"]["dependencies"])
    if "dev" in lock:
        requirements += project["project"]["optional-dependencies"]["dev"]
    pins = _pins(root / lock)
    for requirement in map(Requirement, requirements):
        version = pins[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version), f"run make lock: {requirement} {version}"


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_is_pinned_hashed_and_names_no_place(root: Path, lock: str) -> None:
    text = (root / lock).read_text("utf-8")
    entries = re.split(r"\n(?=\S)", re.sub(r"^\s*#.*\n?", "", text, flags=re.MULTILINE).strip())
    assert entries
    for entry in entries:
        assert PIN.match(entry), f"not a pin: {entry.splitlines()[0]}"
        assert "--hash=sha256:" in entry, f"no hash: {entry.splitlines()[0]}"
    assert not re.search(r"://|--\w*index|--find-links|file:| @ ", text)


def test_the_lock_of_the_embedded_model_holds_its_two_packages_alone(
    root: Path, project: dict[str, Any]
) -> None:
    """Without what they depend on: the model's package would bring a compiler's work along."""
    wanted = project["dependency-groups"]["local"]
    pins = _pins(root / "requirements-local.lock")
    assert set(pins) == _declared(wanted)
    for requirement in map(Requirement, wanted):
        assert requirement.specifier.contains(pins[canonicalize_name(requirement.name)])
    assert set(project["project"]["optional-dependencies"]["local"]) < set(wanted)


def test_the_development_lock_contains_the_runtime_lock(root: Path) -> None:
    runtime, development = _pins(root / "requirements.lock"), _pins(root / "requirements-dev.lock")
    assert {name: development.get(name) for name in runtime} == runtime
