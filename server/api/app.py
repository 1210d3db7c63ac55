"""The web application: REST, stream, health, and the console where one is installed."""

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from importlib.metadata import entry_points

from fastapi import FastAPI, Request
from starlette.exceptions import HTTPException

from server.api import errors, health, missions, stream
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
    settings: Settings, service: MissionService, console: MountConsole | None = None
) -> FastAPI:
    """Return the application around a service that it opens and closes.

    Raises server.api.security.ExposureRefused when it would listen beyond this machine
    without tokens.
    """
    check_exposure(settings.host, settings.tokens())

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with service:
            yield

    app = FastAPI(
        title="Falconer", docs_url=None, redoc_url=None, openapi_url=None, lifespan=lifespan
    )
    app.state.service = service
    errors.install(app)
    app.include_router(health.router)
    app.mount(API_PREFIX, _create_api(service))
    app.add_api_route("/api/{path:path}", _no_such_route, methods=_METHODS, include_in_schema=False)
    if console is not None:
        console(app, service)
    app.add_middleware(BodyLimit)
    app.add_middleware(
        Doorkeeper,
        operator_tokens=settings.operator_tokens(),
        viewer_tokens=settings.viewer_tokens(),
    )
    return app


_METHODS = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"]


def _create_api(service: MissionService) -> FastAPI:
    """Return the API as an application of its own, so that its errors are all in one shape."""
    api = FastAPI(
        title="Falconer",
        version="1",
        summary="Missions of supervised robot teams.",
        docs_url=None,
        redoc_url=None,
    )
    api.state.service = service
    errors.install(api)
    api.include_router(missions.router)
    api.include_router(stream.router)
    return api


async def _no_such_route(request: Request) -> None:
    raise HTTPException(404, "no such route")
