"""The web application: REST, stream, health, and the console where one is installed."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from importlib.metadata import entry_points

from fastapi import FastAPI, Request
from starlette.exceptions import HTTPException

from server.api import (
    alarming,
    directing,
    errors,
    experiments,
    health,
    login,
    metrics,
    missions,
    recordings,
    stream,
)
from server.api.access import Access, Door
from server.api.archive import Archive
from server.api.attribution import Attribution
from server.api.laboratory import Laboratory
from server.api.openapi import describe
from server.api.rate import Buckets, RateLimit
from server.api.security import BodyLimit, Doorkeeper, check_exposure
from server.api.service import MissionService
from server.settings import Settings

API_PREFIX = "/api/v1"
CONSOLE_GROUP = "falconer.console"

MountConsole = Callable[[FastAPI, MissionService], None]


def installed_console() -> MountConsole | None:
    """Return the console's mount function, found by its entry point, None where none is."""
    found = next(iter(entry_points(group=CONSOLE_GROUP)), None)
    if found is None:
        return None
    mount: MountConsole = found.load()
    return mount


def create_app(
    settings: Settings,
    service: MissionService,
    console: MountConsole | None = None,
    door: Door | None = None,
) -> FastAPI:
    """Return the application around a service that it opens and closes.

    Raises server.api.security.ExposureRefused when it would listen beyond this machine
    without tokens. `door` says who may come in; None for one made from the settings.
    """
    check_exposure(settings.host, settings.tokens())
    door = door or Access(settings)

    archive = Archive(service, settings.recordings)
    laboratory = Laboratory(settings.state_folder())
    api = _create_api(service, archive, door)
    api.state.laboratory = laboratory

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with service:
            if isinstance(door, Access):
                for session in await service.chronicle.ended_sessions():
                    door.sessions.revoke(session)
            try:
                yield
            finally:
                await laboratory.close()

    app = FastAPI(
        title="Falconer", docs_url=None, redoc_url=None, openapi_url=None, lifespan=lifespan
    )
    app.state.service = service
    app.state.archive = archive
    app.state.laboratory = laboratory
    app.state.door = door
    errors.install(app)
    app.include_router(health.router)
    app.include_router(metrics.router)
    app.include_router(login.pages)
    app.mount(API_PREFIX, api)
    app.add_api_route("/api/{path:path}", _no_such_route, methods=_METHODS, include_in_schema=False)
    if console is not None:
        console(app, service)
    app.add_middleware(Attribution, service=service)
    app.add_middleware(BodyLimit)
    app.add_middleware(RateLimit, buckets=Buckets(settings.request_rate))
    app.add_middleware(Doorkeeper, door=door)
    return app


_METHODS = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"]


def _create_api(service: MissionService, archive: Archive, door: Door) -> FastAPI:
    """Return the API as an application of its own, so that its errors are all in one shape."""
    api = FastAPI(
        title="Falconer",
        version="1",
        summary="Missions of supervised robot teams.",
        docs_url=None,
        redoc_url=None,
    )
    api.state.service = service
    api.state.archive = archive
    api.state.door = door
    errors.install(api)
    api.include_router(missions.router)
    api.include_router(recordings.router)
    api.include_router(directing.router)
    api.include_router(alarming.router)
    api.include_router(stream.router)
    api.include_router(experiments.router)
    api.include_router(login.router)
    describe(api)
    return api


async def _no_such_route(request: Request) -> None:
    raise HTTPException(404, "no such route")
