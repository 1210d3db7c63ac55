"""What the checks of the house look at: the project's own files."""

import ast
import subprocess
from collections.abc import Iterator
from pathlib import Path

PACKAGES = ("solver", "llm", "vehicles", "server", "console", "scenarios")
"""Every folder that is installed."""

CHECKS = ("tests", "benchmarks")
"""Every folder of Python that is not."""


def python_files(root: Path, folders: tuple[str, ...]) -> list[Path]:
    """Return the Python files of some top-level folders, sorted."""
    return sorted(file for folder in folders for file in (root / folder).rglob("*.py"))


def project_files(root: Path) -> list[Path]:
    """Return all files of the project: the tracked ones, or all in an unpacked archive."""
    if (root / ".git").exists():
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=root,
            capture_output=True,
            text=True,
            check=True,
        )
        names = [name for name in listed.stdout.split("\0") if name]
        return sorted(root / name for name in names if (root / name).is_file())
    hidden = (".venv", ".mypy_cache", ".ruff_cache", ".hypothesis")
    return sorted(
        file for file in root.rglob("*") if file.is_file() and not set(hidden) & set(file.parts)
    )


def functions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Yield every function and method of a module, nested ones too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def imported_names(tree: ast.Module) -> set[str]:
    """Return the top-level names of everything a module imports absolutely."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names
