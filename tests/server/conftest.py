"""What holds for every test of the server."""

import pytest


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a disk take its time: a busy machine's is no database that is gone."""
    monkeypatch.setattr("server.journal.store.OPERATION_S", 40.0)
    monkeypatch.setattr("server.journal.database.COMMIT_S", 40.0)
    monkeypatch.setattr("server.journal.database.CLOSE_S", 40.0)
