"""Property tests of the language layer have no deadline: how fast a machine is proves nothing."""

import pytest
from hypothesis import settings


@pytest.fixture(autouse=True, scope="session")
def without_deadlines() -> None:
    """Let examples take the time they need on a busy machine."""
    settings.register_profile("patient", deadline=None)
    settings.load_profile("patient")
