"""Scenarios that were uploaded: checked, and kept in the journal."""

import asyncio
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any, Final

from server.api.catalogue import Catalogue
from server.api.chronicle import unavailable
from server.api.errors import ServiceError
from server.api.models import MissionRequest, ScenarioInfo
from server.journal.entry import Entry, EntryKind
from server.journal.journal import Journal, JournalUnavailable

MAX_SCENARIOS: Final = 200


class ScenarioShelf:
    """Owner of the uploaded scenarios. `load` it once the journal is open."""

    def __init__(self, catalogue: Catalogue, journal: Journal) -> None:
        self._catalogue = catalogue
        self._journal = journal
        self._kept: dict[str, dict[str, Any]] = {}
        self._infos: dict[str, ScenarioInfo] = {}
        self._changing = asyncio.Lock()

    async def load(self) -> None:
        """Read what was uploaded before. Raises JournalUnavailable."""
        for entry in await self._journal.read("", (EntryKind.SCENARIO,), limit=100_000):
            name, scenario = entry.data["name"], entry.data.get("scenario")
            if scenario is None:
                self._drop(name)
                continue
            try:
                self._take(self._catalogue.describe(scenario), scenario)
            except ServiceError:
                continue  # of another version: it cannot be flown any more

    def infos(self) -> tuple[ScenarioInfo, ...]:
        """Return what is on the shelf."""
        return tuple(self._infos.values())

    def resolved(self, request: MissionRequest) -> MissionRequest:
        """Return a request for an uploaded scenario as one for the object itself."""
        if isinstance(request.scenario, str) and request.scenario in self._kept:
            return request.model_copy(update={"scenario": self._kept[request.scenario]})
        return request

    def one(self, name: str) -> dict[str, Any]:
        """Return an uploaded scenario. Raises ServiceError 404."""
        if name not in self._kept:
            raise ServiceError(
                "scenario_unknown", f"Nobody has uploaded {name}.", HTTPStatus.NOT_FOUND
            )
        return self._kept[name]

    async def add(self, scenario: Mapping[str, Any], author: str) -> ScenarioInfo:
        """Check a scenario and keep it. Raises ServiceError 409, 422, 503."""
        info = await asyncio.to_thread(self._catalogue.describe, dict(scenario))
        async with self._changing:
            self._check_room(info.name)
            await self._write({"name": info.name, "scenario": dict(scenario)}, author)
            self._take(info, dict(scenario))
        return info

    async def remove(self, name: str, author: str) -> None:
        """Forget an uploaded scenario. Raises ServiceError 404, 503."""
        async with self._changing:
            self.one(name)
            await self._write({"name": name}, author)
            self._drop(name)

    def _check_room(self, name: str) -> None:
        """Raise ServiceError 409 when a name is taken, or there is no room for another."""
        if name in {known.name for known in self._catalogue.scenarios()} | set(self._kept):
            raise ServiceError(
                "scenario_exists",
                f"There is a scenario {name} already; give this one another name.",
                HTTPStatus.CONFLICT,
            )
        if len(self._kept) >= MAX_SCENARIOS:
            raise ServiceError(
                "too_many_scenarios",
                f"{MAX_SCENARIOS} scenarios are kept already; delete one first.",
                HTTPStatus.CONFLICT,
            )

    async def _write(self, body: dict[str, Any], author: str) -> None:
        try:
            await self._journal.commit(Entry(EntryKind.SCENARIO, author=author, body=body))
        except JournalUnavailable as error:
            raise unavailable(error) from error

    def _take(self, info: ScenarioInfo, scenario: dict[str, Any]) -> None:
        self._kept[info.name], self._infos[info.name] = scenario, info

    def _drop(self, name: str) -> None:
        self._kept.pop(name, None)
        self._infos.pop(name, None)
