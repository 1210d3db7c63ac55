"""The program that tests the tests: what it draws, counts and tells."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest

from benchmarks.mutants.quick_first import pytest_collection_modifyitems
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


class _Item:
    def __init__(self, nodeid: str) -> None:
        self.nodeid = nodeid


def test_quick_tests_come_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    items = [_Item(name) for name in ("new", "slow", "quick")]
    pytest_collection_modifyitems(items)  # type: ignore[arg-type]
    assert [item.nodeid for item in items] == ["new", "slow", "quick"], "nothing is known yet"
    Path("mutmut-stats.json").write_text('{"duration_by_test": {"slow": 9.0, "quick": 0.1}}')
    pytest_collection_modifyitems(items)  # type: ignore[arg-type]
    assert [item.nodeid for item in items] == ["quick", "slow", "new"]
