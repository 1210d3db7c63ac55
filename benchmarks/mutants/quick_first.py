"""A plug-in of pytest: quick tests first, so that most mutants are found out within a second."""

import json
from pathlib import Path

import pytest

_TIMES = Path("mutmut-stats.json")
"""What mutmut measured when it ran every test once, in the folder where it runs them."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the tests by how long they took; a test never timed goes last."""
    if _TIMES.exists():
        taken_s = json.loads(_TIMES.read_text("utf-8"))["duration_by_test"]
        items.sort(key=lambda item: taken_s.get(item.nodeid, float("inf")))
