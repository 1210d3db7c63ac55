"""What a desk writes into the journal, and what it tells whoever sits there."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from console.board import Board
from console.panel import Desk
from server.api.errors import ServiceError
from server.api.identity import Identity, Role
from server.api.models import MissionRequest
from server.journal.entry import EntryKind
from tests.server.api.serving import Stage


@pytest.mark.asyncio
async def test_what_is_asked_at_a_desk_is_attributed() -> None:
    stage = Stage()
    async with stage.service as service:
        board: Any = SimpleNamespace(service=service)
        desk = Desk(cast("Board", board), Identity("ada", Role.ADMIN))
        desk.note("open replay", recording="demo-1.mcap")
        await service.create(MissionRequest(scenario="scripted"), "ada")  # commits what waits
        (entry,) = await service.chronicle.journal.read("", (EntryKind.REQUEST,))
        assert entry.author == "ada"
        assert entry.data == {"console": "open replay", "asked": {"recording": "demo-1.mcap"}}


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ServiceError("wrong_state", "Mission m1 is ended.", 409), "Mission m1 is ended."),
        (KeyError("changes"), "That failed, and may not have been done"),
    ],
)
async def test_what_was_not_done_is_told(
    monkeypatch: pytest.MonkeyPatch, error: Exception, words: str
) -> None:
    told: list[str] = []
    monkeypatch.setattr(Desk, "tell", lambda _, said: told.append(said))
    board: Any = SimpleNamespace(service=None, mission=SimpleNamespace(id="m1"))

    async def do(service: object, mission: str, author: str) -> str:
        raise error

    assert await Desk(board, Identity("ada", Role.OPERATOR)).act(do) is None
    assert len(told) == 1
    assert words in told[0]
