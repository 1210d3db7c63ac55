"""Forks and recordings as everybody sees them; nothing is computed."""

import asyncio
from typing import Any, cast

import pytest

from console.workshop import FORKS_KEPT, Change, Workshop
from server.api.archive import Archive
from server.api.errors import ServiceError
from server.mission.setup import GateMode
from tests.server.waiting import eventually

CHANGE = Change("m1", 60.0, "mock", GateMode.AUTO, "Track more boldly.")
STORY = {"at_s": 60.0, "until_s": 90.0, "recorded": {}, "forked": {}}


class Shelf:
    """Answers as the archive does."""

    def __init__(self) -> None:
        self.asked: list[tuple[Any, ...]] = []
        self.refusal: ServiceError | None = None
        self.go = asyncio.Event()

    async def recordings(self) -> list[dict[str, Any]]:
        return [{"name": "demo-1.mcap"}]

    async def fork(self, *asked: Any) -> dict[str, Any]:
        self.asked.append(asked)
        await self.go.wait()
        if self.refusal is not None:
            raise self.refusal
        return STORY


def workshop(shelf: Shelf) -> Workshop:
    return Workshop(lambda: cast("Archive", shelf), lambda: None)  # type: ignore[arg-type, return-value]


@pytest.mark.asyncio
async def test_a_fork_is_under_way_until_its_story_is_there() -> None:
    shelf = Shelf()
    shop = workshop(shelf)
    made = shop.fork(CHANGE, "ada")
    await eventually(lambda: bool(shelf.asked))
    assert not made.done
    assert shelf.asked == [
        ("m1", 60.0, "mock", GateMode.AUTO, None, [(60.0, "Track more boldly.")])
    ]
    before = shop.version
    shelf.go.set()
    await eventually(lambda: made.done)
    assert made.story == STORY
    assert shop.version > before
    await shop.close()


@pytest.mark.asyncio
async def test_a_refusal_is_told_in_words_and_the_oldest_are_forgotten() -> None:
    shelf = Shelf()
    shelf.refusal = ServiceError("busy", "A fork is being computed; try again.", 429)
    shelf.go.set()
    shop = workshop(shelf)
    made = [shop.fork(CHANGE, "ada") for _ in range(FORKS_KEPT + 3)]
    await eventually(lambda: all(one.done for one in made))
    assert {one.error for one in made} == {"A fork is being computed; try again."}
    assert [one.number for one in shop.forks] == list(range(4, FORKS_KEPT + 4))
    await shop.close()


@pytest.mark.asyncio
async def test_closing_ends_what_is_under_way() -> None:
    shelf = Shelf()
    shop = workshop(shelf)
    made = shop.fork(CHANGE, "ada")
    await eventually(lambda: bool(shelf.asked))
    await shop.close()
    assert not made.done


@pytest.mark.asyncio
async def test_recordings_are_there_once_they_were_looked_at() -> None:
    shop = workshop(Shelf())
    shop.look()
    await eventually(lambda: shop.recordings is not None)
    assert shop.recordings == [{"name": "demo-1.mcap"}]
    await shop.close()
