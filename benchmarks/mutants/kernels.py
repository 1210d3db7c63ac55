"""A copy of the project in which the kernels are plain Python functions, to make errors in them.

mutmut leaves decorated functions alone, and a compiled kernel could not be exchanged while the
program runs. Without the line of its decorator a kernel is a function like any other.
"""

import re
from pathlib import Path

_COPIED = ("solver", "benchmarks", "tests")
_KERNELS = Path("solver") / "engines" / "fast"
_DECORATOR = re.compile(r"^@(kernel|maker|inlined|merged)\n", re.MULTILINE)
_SETTINGS = re.compile(r"^\[tool\.mutmut\].*?(?=^# -{9})", re.MULTILINE | re.DOTALL)


def stage(root: Path, folder: Path) -> None:
    """Make the copy in a folder, or bring it up to date.

    A file that is the same as before is left alone, so that what mutmut knows of it holds on.
    """
    for name in _COPIED:
        for source in sorted((root / name).rglob("*.py")):
            path = source.relative_to(root)
            text = source.read_text("utf-8")
            _write(folder / path, plain(text) if path.parent == _KERNELS else text)
    project = (root / "pyproject.toml").read_text("utf-8")
    own = Path(__file__).with_suffix(".toml").read_text("utf-8")
    _write(folder / "pyproject.toml", _SETTINGS.sub("", project) + "\n" + own)


def plain(source: str) -> str:
    """Return the source of a module with the decorators of its kernels left out."""
    return _DECORATOR.sub("", source)


def _write(file: Path, text: str) -> None:
    if not file.exists() or file.read_text("utf-8") != text:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, "utf-8")
