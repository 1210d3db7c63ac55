"""The program that tests the tests: what it draws, counts and tells."""

import json
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path

import pytest

from benchmarks.mutants.kernels import plain, stage
from benchmarks.mutants.quick_first import PATIENCE_S, pytest_collection_modifyitems
from benchmarks.mutants.results import Module, drawn, modules, summary

KILLED, SURVIVED, NO_TESTS, TIME_OUT = 1, 0, 33, -24


def left_behind(folder: Path, **files: Mapping[str, int | None]) -> Path:
    """Write what mutmut leaves behind of some modules of the solver and of the verification."""
    for name, results in files.items():
        file = folder / f"{name.replace('_', '/')}.py.meta"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps({"exit_code_by_key": results}))
    return folder


def test_shares_are_weighed_by_the_size_of_a_module(tmp_path: Path) -> None:
    small = {"solver.small.x_f__mutmut_1": SURVIVED, "solver.small.x_f__mutmut_2": NO_TESTS}
    large = {f"solver.large.x_f__mutmut_{k}": KILLED if k < 3 else None for k in range(6)}
    sure = {"llm.verification.x_g__mutmut_1": TIME_OUT}
    left_behind(tmp_path, solver_small=small, solver_large=large, llm_verification=sure)
    found = modules(left_behind(tmp_path, solver_arrays={}))
    assert [module.name for module in found] == ["llm.verification", "solver.large", "solver.small"]
    told = summary(found).splitlines()
    assert "| `solver.large` | 6 | 3 | 100 % |" in told
    assert "| `solver.small` | 2 | 2 | 0 % |" in told
    assert "| **solver** | 8 | 5 | **75 %** |" in told
    assert "| **llm** | 1 | 1 | **100 %** |" in told
    assert told[-3:] == ["2 survived:", *small]


def test_a_module_never_tried_is_not_told_of() -> None:
    assert "solver.fusion" not in summary([Module("solver.fusion", {"a": None})])


def test_a_sample_is_the_same_for_the_same_seed_and_never_too_large() -> None:
    module = Module("solver.fusion", {f"m{k}": None for k in range(100)})
    assert drawn(module, 10, seed=3) == drawn(module, 10, seed=3)
    assert drawn(module, 10, seed=3) != drawn(module, 10, seed=4)
    assert len(set(drawn(module, 10, seed=3))) == 10
    assert drawn(module, 200, seed=0) == sorted(module.results)


def test_kernels_are_counted_by_themselves(tmp_path: Path) -> None:
    killed, survived = ({f"m{k}": code for k in range(4)} for code in (KILLED, SURVIVED))
    left_behind(tmp_path, solver_fusion=killed)
    copy = left_behind(tmp_path / "kernels" / "mutants", solver_engines_fast_rows=survived)
    assert [module.name for module in modules(tmp_path)] == ["solver.fusion"]
    told = summary([*modules(tmp_path), *modules(copy)]).splitlines()
    assert "| `solver.engines.fast.rows` | 4 | 4 | 0 % |" in told
    assert "| **solver** | 4 | 4 | **100 %** |" in told
    assert "| **kernels** | 4 | 4 | **0 %** |" in told


class _Item:
    def __init__(self, nodeid: str) -> None:
        self.nodeid = nodeid
        self.timeouts: list[float] = []

    def add_marker(self, marker: pytest.MarkDecorator, append: bool) -> None:
        self.timeouts.append(marker.args[0])


def chosen(taken_s: Mapping[str, float]) -> list[_Item]:
    """Return what is left of tests that took so long, and one that is new."""
    Path("mutmut-stats.json").write_text(json.dumps({"duration_by_test": dict(taken_s)}))
    items = [_Item(name) for name in ("new", *taken_s)]
    pytest_collection_modifyitems(items)  # type: ignore[arg-type]
    return items


def test_quick_tests_come_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    items = [_Item(name) for name in ("new", "slow", "quick")]
    pytest_collection_modifyitems(items)  # type: ignore[arg-type]
    assert [item.nodeid for item in items] == ["new", "slow", "quick"], "nothing is known yet"
    items = chosen({"slow": 9.0, "quick": 0.1})
    assert [item.nodeid for item in items] == ["quick", "slow", "new"]
    assert items[0].timeouts[0] > 1.0, "a busy machine is no error"
    assert items[1].timeouts[0] > 20.0


def test_tests_that_take_too_long_together_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    times = {"a": 0.5 * PATIENCE_S, "b": 0.4 * PATIENCE_S, "c": 0.6 * PATIENCE_S}
    assert [item.nodeid for item in chosen(times)] == ["b", "a"]
    assert [item.nodeid for item in chosen({"alone": 3.0 * PATIENCE_S})] == ["alone"]
    for needs_all in ("stats", "list_all_tests"):
        monkeypatch.setenv("MUTANT_UNDER_TEST", needs_all)
        assert len(chosen(times)) == 4


def test_kernels_lose_their_decorators_and_nothing_else() -> None:
    source = "@kernel\ndef f(x):\n    return x\n\n\n@cache\ndef g():\n    return f\n"
    assert plain(source) == source.removeprefix("@kernel\n")


def test_the_copy_has_settings_of_its_own_and_touches_only_what_has_changed(
    root: Path, tmp_path: Path
) -> None:
    stage(root, tmp_path)
    project = tomllib.loads((tmp_path / "pyproject.toml").read_text())
    assert project["tool"]["mutmut"]["source_paths"] == ["solver"]
    assert "pytest" in project["tool"]
    engine = tmp_path / "solver" / "engines" / "fast"
    assert "@kernel" not in "".join(file.read_text() for file in engine.glob("*.py"))
    kept = {file: file.stat().st_mtime_ns for file in engine.glob("*.py")}
    changed = engine / "rows.py"
    changed.write_text("")
    stage(root, tmp_path)
    kept.pop(changed)
    assert {file: file.stat().st_mtime_ns for file in kept} == kept
    assert changed.read_text()


def test_plain_kernels_pass_their_tests_and_an_error_in_one_does_not(
    root: Path, tmp_path: Path
) -> None:
    stage(root, tmp_path)
    tests = "tests/solver/engines/test_fast_derivatives.py"
    arguments = ["-q", "--rootdir=.", "-p", "benchmarks.mutants.plain", "-k", "symbolic", tests]
    command = [sys.executable, "-m", "pytest", *arguments]
    first = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert first.returncode == 0, first.stdout
    with (tmp_path / "solver" / "engines" / "fast" / "robot.py").open("a") as kernels:
        kernels.write("\n\ndef pull_back(team):\n    return None\n")
    second = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert second.returncode == 1, second.stdout
