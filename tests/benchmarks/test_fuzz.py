"""A few hundred generated requests find nothing; `benchmarks.fuzz` makes thousands."""

import re
from pathlib import Path

import pytest

from benchmarks.fuzz import fuzz


@pytest.mark.process
@pytest.mark.timeout(400)
def test_generated_requests_find_nothing(tmp_path: Path) -> None:
    done = fuzz(1, 2, tmp_path)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    found = re.search(r"(\d+) generated", done.stdout)
    assert found is not None
    assert int(found[1]) >= 300
