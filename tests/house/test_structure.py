"""Files and functions stay short enough to be read, and nothing names the machine it grew on."""

import ast
import re
from pathlib import Path

import pytest

from tests.house.sources import CHECKS, PACKAGES, functions, project_files, python_files

MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 60

MACHINE_PATH = re.compile(r"(?<![\w.$}])/(?:root|home/\w+|Users/\w+|work|opt/\w+)/[\w.]")
OUTSIDE_PATH = re.compile(r"\.\./sha" + r"red\b")
REGISTRY = re.compile(r"py" + r"pi\.org|python" + r"hosted|npm" + r"js\.org|deb\.deb" + r"ian\.org")


def long_functions(source: str) -> list[str]:
    """Return "name (n lines)" for every function too long, its docstring not counted."""
    found = []
    for function in functions(ast.parse(source)):
        first = function.body[0]
        documented = ast.get_docstring(function, clean=False) is not None
        docstring = (first.end_lineno or 0) - first.lineno + 1 if documented else 0
        lines = (function.end_lineno or 0) - function.lineno + 1 - docstring
        if lines > MAX_FUNCTION_LINES:
            found.append(f"{function.name} ({lines} lines)")
    return found


def foreign_names(text: str) -> list[str]:
    """Return every path of a machine and every host of a package registry in a text."""
    patterns = (MACHINE_PATH, OUTSIDE_PATH, REGISTRY)
    return [match.group() for pattern in patterns for match in pattern.finditer(text)]


def test_files_are_short(root: Path) -> None:
    lengths = {
        str(file.relative_to(root)): len(file.read_text("utf-8").splitlines())
        for file in python_files(root, PACKAGES + CHECKS)
    }
    assert lengths
    assert {name: n for name, n in lengths.items() if n > MAX_FILE_LINES} == {}, (
        f"split files of more than {MAX_FILE_LINES} lines"
    )


def test_functions_are_short(root: Path) -> None:
    found = {
        str(file.relative_to(root)): long
        for file in python_files(root, PACKAGES)
        if (long := long_functions(file.read_text("utf-8")))
    }
    assert found == {}, f"split functions of more than {MAX_FUNCTION_LINES} lines"


def test_nothing_names_a_machine(root: Path) -> None:
    found = {}
    for file in project_files(root):
        try:
            text = file.read_text("utf-8")
        except UnicodeDecodeError:
            continue  # a picture or a recording
        if names := foreign_names(text):
            found[str(file.relative_to(root))] = names
    assert found == {}, "a path or host of one machine means nothing on another"


def _function(lines: int, docstring: str = "") -> str:
    """Return the source of a function with so many lines, its docstring not counted."""
    return "\n".join(["def example():", docstring, *["    x = 1"] * (lines - 1)])


def test_long_functions_are_found() -> None:
    long_docstring = '    """Say much.\n' + "\n" * MAX_FUNCTION_LINES + '    """'
    assert long_functions(_function(MAX_FUNCTION_LINES, '    """Say little."""')) == []
    assert long_functions(_function(MAX_FUNCTION_LINES, long_docstring)) == []
    assert long_functions(_function(MAX_FUNCTION_LINES + 1, long_docstring)) == [
        f"example ({MAX_FUNCTION_LINES + 1} lines)"
    ]


@pytest.mark.parametrize(
    "text",
    [
        "see /ro" + "ot/.bashrc",
        '"/ho' + 'me/someone/falconer"',
        "cd /wo" + "rk/main",
        "../sha" + "red/paper",
        "https://py" + "pi.org/simple",
    ],
)
def test_foreign_names_are_found(text: str) -> None:
    assert len(foreign_names(text)) == 1


@pytest.mark.parametrize("text", ["/api/v1/missions", "./home/page", "$HOME/x", "work/life"])
def test_other_names_are_left_alone(text: str) -> None:
    assert foreign_names(text) == []
