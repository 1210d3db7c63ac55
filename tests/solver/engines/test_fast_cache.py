"""The disk cache of machine code: right key, right place, and honest when it cannot be kept."""

import ast
import logging
import shutil
from pathlib import Path

import pytest
from numba import types

from solver.engines.fast import compiled as cache
from solver.engines.fast.compile import main
from solver.engines.fast.request import signature

PACKAGE = Path(cache.__file__).parent

ALLOWED = {
    "jit": {"numba"},
    "request": {"numba"},
    "clock": {"numba", "time"},
    "derivatives": {"numba"},
}
"""What modules with kernels may import beside the standard mathematics and the package."""


def doubled(value: float) -> float:
    """Stand in for the routine: quick to compile."""
    return 2.0 * value


def test_machine_code_is_kept_under_the_key_of_the_sources(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
    first = cache.compile_cached(doubled, types.float64(types.float64))
    assert first(21.0) == 42.0
    kept = list((tmp_path / cache.source_key()).iterdir())
    assert {path.suffix for path in kept} == {".nbi", ".nbc"}
    again = cache.compile_cached(doubled, types.float64(types.float64))
    assert again(21.0) == 42.0
    assert sum(again.stats.cache_hits.values()) == 1  # type: ignore[attr-defined]


def test_any_changed_source_changes_the_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numba itself looks at the file of the outermost function only."""
    copy = tmp_path / "fast"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(cache, "_PACKAGE", copy)
    keys = {cache.source_key()}
    sources = sorted(copy.glob("*.py"))
    for path in sources:
        path.write_text(path.read_text() + "\n# changed\n")
        keys.add(cache.source_key())
    assert len(keys) == len(sources) + 1


def test_kernels_use_nothing_that_the_key_does_not_cover() -> None:
    """A constant or helper from another package would be compiled in unnoticed."""
    outside = {"compile", "compiled", "engine", "packing", "__init__"}
    for path in sorted(PACKAGE.glob("*.py")):
        if path.stem in outside:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                module = node.module or ""
            elif isinstance(node, ast.Import):
                module = node.names[0].name
            else:
                continue
            own = module.startswith("solver.engines.fast")
            plain = module in {"math", "numpy", "typing", "collections.abc", "functools"}
            named = module in {"solver.arrays", "solver.problem"}  # types alone
            assert own or plain or named or module in ALLOWED.get(path.stem, set()), (path, module)


def test_a_disk_that_cannot_be_written_costs_no_more_than_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a directory")
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(blocked))
    with caplog.at_level(logging.WARNING):
        run = cache.compile_cached(doubled, types.float64(types.float64))
    assert run(1.0) == 2.0
    assert "could not be cached" in caplog.text


def test_the_place_is_beside_the_sources_if_it_can_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(cache.CACHE_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(cache, "_PACKAGE", tmp_path)
    assert cache.cache_directory("k") == tmp_path / "__pycache__" / "kernels-k"
    monkeypatch.setattr("os.access", lambda path, mode: False)
    assert cache.cache_directory("k") == tmp_path / "home" / "falconer" / "k"
    (tmp_path / "__pycache__" / "kernels-k").mkdir(parents=True)
    assert cache.cache_directory("k") == tmp_path / "__pycache__" / "kernels-k"


@pytest.mark.timeout(900)
def test_the_command_says_where_the_kernels_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    said = capsys.readouterr().out
    assert "kernels ready" in said
    assert str(cache.cache_directory(cache.source_key())) in said


def test_the_signature_is_explicit() -> None:
    assert signature().args
    assert cache.compiled() is cache.compiled()
    assert not cache.compiled()._can_compile  # type: ignore[attr-defined]
