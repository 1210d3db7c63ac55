"""The application under test: in process for REST, on a real port for sockets."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, Self
from weakref import finalize

import httpx
import uvicorn
from fastapi import FastAPI
from starlette.types import Scope

from server.api.app import create_app
from server.api.catalogue import Definition
from server.api.identity import Identity, Role
from server.api.service import MissionService
from server.api.web import web_config
from server.journal.database import DatabaseJournal
from server.journal.store import Store
from server.settings import Settings
from tests.server.scripted import ScriptedCatalogue, ScriptedHost

UNHURRIED = 1e6
"""Requests per second: a test that waits for something asks as often as it likes."""


class OpenDoor:
    """Lets everybody on this machine do everything: tests of other things need no login."""

    beyond = False

    def identify(self, scope: Scope) -> Identity:
        return Identity("operator", Role.ADMIN)

    def still(self, identity: Identity) -> bool:
        return True


class StagedService(MissionService):
    """A service that opens its journal itself, so that a test needs one context only."""

    async def __aenter__(self) -> Self:
        await self._journal.__aenter__()
        return await super().__aenter__()

    async def __aexit__(self, *failure: Any) -> None:
        await super().__aexit__(*failure)
        await self._journal.__aexit__(*failure)


@dataclass
class Stage:
    """A service whose missions follow a script, and the hosts it made."""

    planners: list[ScriptedHost] = field(default_factory=list)
    worlds: list[ScriptedHost] = field(default_factory=list)
    fail_start: bool = False
    period_s: float = 0.01

    folder: Path = field(default_factory=lambda: Path(mkdtemp(prefix="falconer-stage-")))
    """Holds the journal; removed when the service is closed."""

    def __post_init__(self) -> None:
        finalize(self, rmtree, self.folder, ignore_errors=True)
        journal = DatabaseJournal(Store(f"sqlite:///{self.folder / 'journal.db'}"))
        self.service = StagedService(ScriptedCatalogue(), self.planner, self.world, journal)

    def planner(self, definition: Definition) -> ScriptedHost:
        self.planners.append(
            ScriptedHost(definition, fail_start=self.fail_start, period_s=self.period_s)
        )
        return self.planners[-1]

    def world(self, definition: Definition) -> ScriptedHost:
        self.worlds.append(ScriptedHost(definition, period_s=1000.0))
        return self.worlds[-1]

    def app(self, **settings: object) -> FastAPI:
        known = Settings.model_validate({"request_rate": UNHURRIED, **settings})
        return create_app(known, self.service, door=None if known.tokens() else OpenDoor())


@asynccontextmanager
async def client_of(
    app: FastAPI, stage: Stage, address: str = "http://127.0.0.1:8000", **options: object
) -> AsyncIterator[httpx.AsyncClient]:
    """A client in the same process; the service is open meanwhile."""
    transport = httpx.ASGITransport(app=app, raise_app_exceptions=False)
    async with (
        stage.service,
        httpx.AsyncClient(transport=transport, base_url=address, **options) as client,  # type: ignore[arg-type]
    ):
        yield client


@asynccontextmanager
async def served(app: FastAPI) -> AsyncIterator[str]:
    """The application on a real port of 127.0.0.1; yields "127.0.0.1:port"."""
    server = uvicorn.Server(web_config(app, Settings(host="127.0.0.1", port=0)))
    serving = asyncio.create_task(server.serve())
    while not server.started:
        if serving.done():
            serving.result()
        await asyncio.sleep(0.005)
    port = server.servers[0].sockets[0].getsockname()[1]
    try:
        yield f"127.0.0.1:{port}"
    finally:
        server.should_exit = True
        await serving
