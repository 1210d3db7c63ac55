from pathlib import Path
from typing import Any

import pytest

from server.lockstep.job import ScriptedComment
from server.recording import writer
from tests.server.recording.flown import FOCUS, fly

Flight = tuple[Path, dict[str, Any]]


@pytest.fixture(scope="session")
def guided(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """A recorded flight with both models and a comment, and its result."""
    path = tmp_path_factory.mktemp("guided") / "flight.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "CHUNK_BYTES", 16 * 1024)  # many chunks in little time
        return path, fly(path, comments=(ScriptedComment(10.0, FOCUS),))


@pytest.fixture(scope="session")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """A recorded flight that nobody advises, and its result."""
    path = tmp_path_factory.mktemp("alone") / "flight.mcap"
    return path, fly(path, llm="none")
