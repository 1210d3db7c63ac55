"""The board over scripted missions, with a scene that may fail; nothing is drawn."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from console.board import SCENE_FAULT, Board, Facts
from console.scene import Scene
from console.workshop import Workshop
from server.api.errors import ServiceError
from server.api.models import MissionRequest
from tests.server.api.serving import Stage
from tests.server.waiting import eventually

REQUEST = MissionRequest(scenario="scripted")


@dataclass
class PaperScene:
    """Stands where the scene stands."""

    fails: bool = False
    drawn: list[dict[str, Any]] = field(default_factory=list)
    watched: bool = True

    def note(self, snapshot: dict[str, Any]) -> None:
        if self.fails:
            raise ValueError("not a picture")

    def draw(self, snapshot: dict[str, Any]) -> None:
        self.drawn.append(snapshot)

    def close(self) -> None:
        self.watched = False


@dataclass
class Lookout:
    """A board, what it looks at and what it drew its panels from."""

    stage: Stage
    scene: PaperScene
    board: Board
    facts: list[Facts]

    async def fly(self) -> None:
        made = await self.stage.service.create(REQUEST, "operator")
        await self.stage.service.start(made.id, "operator")

    def shows(self, mission_id: str) -> bool:
        """Whether the newest panels are of a mission, with a picture of its own."""
        last = self.facts[-1] if self.facts else None
        return last is not None and last.mission.id == mission_id and last.snapshot is not None


@asynccontextmanager
async def lookout() -> AsyncIterator[Lookout]:
    stage, scene, facts = Stage(), PaperScene(), list[Facts]()

    def draw(seen: Facts) -> dict[str, str]:
        facts.append(seen)
        return {"drawn": str(len(facts))}

    shop = Workshop(lambda: None, lambda: None)  # type: ignore[arg-type, return-value]
    board = Board(stage.service, lambda: cast("Scene", scene), shop, draws=[draw])
    async with stage.service:
        await board.start()
        yield Lookout(stage, scene, board, facts)
        await board.stop()


@pytest.mark.asyncio
async def test_a_scene_that_fails_takes_no_panel_from_sight() -> None:
    async with lookout() as seen:
        seen.scene.fails = True
        await seen.fly()
        await eventually(lambda: seen.shows("m1"))
        await eventually(lambda: seen.facts[-1].scene_fault == SCENE_FAULT)
        assert seen.scene.drawn == []
        seen.scene.fails = False
        await eventually(lambda: bool(seen.scene.drawn))
        await eventually(lambda: seen.facts[-1].scene_fault == "")


@pytest.mark.asyncio
async def test_a_fault_in_one_picture_does_not_end_the_following(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with lookout() as seen:
        wrong = iter([KeyError("changes"), ServiceError("mission_unknown", "There is none.", 404)])
        taken = seen.board._take

        def take(snapshot: dict[str, Any]) -> None:
            for error in wrong:
                raise error
            taken(snapshot)

        monkeypatch.setattr(Board, "_take", lambda _, snapshot: take(snapshot))
        await seen.fly()
        await eventually(lambda: seen.shows("m1"))
        assert next(wrong, None) is None, "both faults have been met"


@pytest.mark.asyncio
async def test_a_mission_removed_while_its_picture_is_read_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with lookout() as seen:
        service = seen.stage.service
        removed: list[str] = []

        async def last(mission_id: str) -> None:
            if not removed:
                removed.append(mission_id)
                await service.delete(mission_id, "operator")

        monkeypatch.setattr(service.hindsight, "last", last)
        await service.create(REQUEST, "operator")
        await eventually(lambda: removed == ["m1"])
        await seen.fly()
        await eventually(lambda: seen.shows("m2"))
