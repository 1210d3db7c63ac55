"""What a desk writes into the journal."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from console.board import Board
from console.panel import Desk
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
