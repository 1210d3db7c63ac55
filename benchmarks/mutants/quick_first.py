"""A plug-in of pytest: quick tests first, and slow ones not at all, so that a mutant takes seconds.

Most mutants are found out by the first tests that reach them. The others would be tried with
every such test, which can take minutes each: here the quickest are enough, PATIENCE_S of them.
So a survivor may be one that a slower test would notice; what is killed is killed.
"""

import json
import os
from pathlib import Path

import pytest
from hypothesis import Phase, settings

PATIENCE_S = 20.0
"""How long all tests of one mutant may take together, as measured without mutants."""

_HANGS_S, _HANGS_TIMES = 10.0, 10.0
"""A test that takes longer than the sum of this and so many times what it took goes on for ever."""

_TIMES = Path("mutmut-stats.json")
"""What mutmut measured when it ran every test once, in the folder where it runs them."""

_ALL = frozenset({"stats", "list_all_tests"})
"""What mutmut calls the runs that need all tests, in place of a mutant's name."""


@pytest.hookimpl(trylast=True)
def pytest_configure() -> None:
    """Look for no simpler example where one has failed."""
    usual = settings.get_profile(settings.get_current_profile_name())
    settings.register_profile("mutants", usual, phases=(Phase.explicit, Phase.generate))
    settings.load_profile("mutants")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the tests by how long they took, the untimed last, and end where patience ends."""
    if not _TIMES.exists() or os.environ.get("MUTANT_UNDER_TEST") in _ALL:
        return
    times_s = json.loads(_TIMES.read_text("utf-8"))["duration_by_test"]
    items.sort(key=lambda item: times_s.get(item.nodeid, float("inf")))
    left_s = PATIENCE_S
    for count, item in enumerate(items):
        taken_s = times_s.get(item.nodeid, 0.0)
        left_s -= taken_s
        if left_s < 0.0 and count > 0:
            del items[count:]
            return
        item.add_marker(pytest.mark.timeout(_HANGS_S + _HANGS_TIMES * taken_s), append=False)
