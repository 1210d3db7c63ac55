"""Which process runs which tests, as the scheduler tells it."""

from types import SimpleNamespace
from typing import Any

from tests.conftest import pytest_collection_modifyitems, pytest_xdist_make_scheduler

TESTS = [f"tests/test_{name}.py::test_{number}" for name in "abcde" for number in range(3)]


class Worker:
    """Stands for a process: keeps what it is told to run."""

    gateway = SimpleNamespace(id="gw")
    shutting_down = False

    def __init__(self) -> None:
        self.told: list[str] = []

    def send_runtest_some(self, indices: list[int]) -> None:
        self.told += [TESTS[index] for index in indices]

    def shutdown(self) -> None:
        """End; nothing is left to run."""


def files(worker: Worker) -> list[str]:
    """Return the letters of the files that a worker was given, in order."""
    return list(dict.fromkeys(test[len("tests/test_")] for test in worker.told))


def test_two_processes_begin_at_both_ends_and_meet() -> None:
    options: dict[str, Any] = {"tx": ["popen", "popen"]}
    config: Any = SimpleNamespace(getvalue=options.get, option=SimpleNamespace())
    shared: Any = pytest_xdist_make_scheduler(config, None)
    first, second = Worker(), Worker()
    for worker in (first, second):
        shared.add_node(worker)
        shared.add_node_collection(worker, TESTS)
    shared.schedule()
    assert (files(first), files(second)) == (["a"], ["e"])
    for worker, number in ((first, 0), (second, 0), (first, 1), (first, 2), (first, 3)):
        shared.mark_test_complete(worker, TESTS.index(worker.told[number]))
    assert (files(first), files(second)) == (["a", "b", "c"], ["e", "d"])
    assert sorted(first.told + second.told) == TESTS


def test_files_that_other_processes_time_come_first() -> None:
    def test(name: str, *markers: str) -> Any:
        found = dict.fromkeys(markers, True)
        return SimpleNamespace(
            path=name, get_closest_marker=found.get, add_marker=lambda mark: None
        )

    items = [test("a"), test("b"), test("b", "process"), test("c"), test("d", "browser")]
    pytest_collection_modifyitems(items)
    assert [item.path for item in items] == ["b", "b", "d", "a", "c"]
