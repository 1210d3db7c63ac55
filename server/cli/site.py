"""The web side of a live server, and a mission of its own where one is named."""

import asyncio
import socket
import sys
from typing import Any

import typer
import uvicorn

from server.api.access import Access
from server.api.app import create_app, installed_console
from server.api.catalogue import Definition
from server.api.clockwatch import ClockWatch
from server.api.errors import ServiceError
from server.api.identity import Role
from server.api.library import ScenarioLibrary
from server.api.recovery import AfterCrash
from server.api.service import MissionService
from server.api.silence import SilenceWatch
from server.api.watch import tell_of_clock
from server.api.web import web_config
from server.cli.errors import UsageError
from server.cli.hosts import planner_host, world_host
from server.cli.live import Until
from server.encoding import MissionState
from server.journal.database import DatabaseJournal
from server.journal.journal import Journal, JournalUnavailable
from server.journal.store import Store, StoreUrlError
from server.live.standby import Start
from server.settings import Settings

AUTHOR = "command line"
LOOK_S = 0.2

_OVER = frozenset({MissionState.ENDED, MissionState.FAILED})


async def serve(
    settings: Settings,
    start: Start,
    listener: socket.socket,
    definition: Definition | None,
    until: Until,
) -> dict[str, Any] | None:
    """Serve on a listening socket until interrupted; fly the definition at once, if any.

    `start` gives the processes of missions. Returns the mission's figures, if there are any.
    Raises UsageError.
    """
    try:
        async with journal_of(settings) as journal:
            return await Site(settings, start, listener, journal).serve(definition, until)
    except JournalUnavailable as error:
        raise UsageError(str(error)) from error


def journal_of(settings: Settings) -> DatabaseJournal:
    """Return the journal that the settings name. Raises UsageError for an address that is none."""
    try:
        return DatabaseJournal(Store(settings.journal_address()))
    except StoreUrlError as error:
        raise UsageError(f"FALCONER_DATABASE_URL: {error}") from error


class Site:
    """Owner of the web application and its server."""

    def __init__(
        self, settings: Settings, start: Start, listener: socket.socket, journal: Journal
    ) -> None:
        resume = AfterCrash.RESUME_SIMULATED if settings.auto_resume else AfterCrash.HOLD
        self._service = MissionService(
            ScenarioLibrary(settings),
            lambda definition: planner_host(definition, start),
            lambda definition: world_host(definition, start),
            journal,
            resume,
        )
        self._door = Access(settings)
        app = create_app(settings, self._service, installed_console(), self._door)
        self._server = uvicorn.Server(web_config(app, settings))
        self._listener = listener
        self._flown: str | None = None

    async def serve(self, definition: Definition | None, until: Until) -> dict[str, Any] | None:
        """Serve until interrupted, or until the mission is over; return its figures.

        Raises UsageError when the mission cannot be started.
        """
        refusal: ServiceError | None = None
        try:
            async with asyncio.TaskGroup() as group:
                serving = group.create_task(
                    self._server.serve(sockets=[self._listener]), name="web server"
                )
                watching = group.create_task(self._watch(), name="watch")
                serving.add_done_callback(lambda _: watching.cancel())
                if await self._started(serving):
                    interrupted = self._welcome()
                    if definition is not None and (not interrupted or until is Until.OVER):
                        try:
                            await self._fly(definition, serving)
                        except ServiceError as error:
                            # Who ends the server while a mission starts is not told that it failed.
                            refusal = None if self._server.should_exit else error
                        self._server.should_exit |= until is Until.OVER or refusal is not None
        except asyncio.CancelledError:
            task = asyncio.current_task()
            if task is None or not serving.done() or serving.cancelled():
                raise
            # Ctrl-C: the server has shut down in order, and then passed the signal on to us.
            task.uncancel()
        if refusal is not None:
            raise UsageError(str(refusal)) from refusal
        return await self._figures()

    async def _watch(self) -> None:
        """Tell the live missions of a wall clock that jumps and a silent planner. Runs for ever."""
        records = self._service.records
        async with asyncio.TaskGroup() as group:
            group.create_task(ClockWatch(lambda words: tell_of_clock(records(), words)).run())
            group.create_task(SilenceWatch(records).run())

    async def _started(self, serving: asyncio.Task[None]) -> bool:
        """Wait until the server listens; return False when it has ended instead.

        The server offers a flag and no event, so it is looked at.
        """
        while not self._server.started:
            done, _ = await asyncio.wait({serving}, timeout=0.02)
            if done:
                return False
        return True

    def _welcome(self) -> bool:
        """Tell where the server is; return whether an interrupted mission comes up."""
        address = _address(self._listener)
        if not self._door.beyond:
            steer = f"{address}{self._door.link(Role.OPERATOR)}"
            _say(f"Open this link to steer; it works once: {steer}")
            admin = f"{address}{self._door.link(Role.ADMIN)}"
            _say(f"Admin, to make and remove missions as well; works once too: {admin}")
        # Last, so that the first address somebody sees is the link that logs in.
        _say(f"Falconer on {address} (Ctrl-C ends it)")
        interrupted = self._service.live_mission()
        if interrupted is None:
            return False
        _say(f"mission {interrupted.id} was interrupted: it comes up, and all robots hold")
        return True

    async def _fly(self, definition: Definition, serving: asyncio.Task[None]) -> None:
        """Start the mission, and wait until it is over or the server ends.

        Raises ServiceError when it cannot be started.
        """
        service = self._service
        interrupted = service.live_mission()
        if interrupted is not None:
            await service.stop(interrupted.id, AUTHOR)
        mission_id = (await service.add(definition, AUTHOR)).id
        _say(f"starting {definition.scenario} ...")
        await service.start(mission_id, AUTHOR)
        self._flown = mission_id
        while not is_over(service, mission_id):
            done, _ = await asyncio.wait({serving}, timeout=LOOK_S)
            if done:
                return

    async def _figures(self) -> dict[str, Any] | None:
        if self._flown is None:
            return None
        try:
            return await self._service.result(self._flown)
        except ServiceError as error:
            _say(f"no figures: {error}")
            return None


def is_over(service: MissionService, mission_id: str) -> bool:
    """Tell whether a mission is over; one that was stopped may have been removed at once."""
    states = {mission.id: mission.state for mission in service.missions()}
    return states.get(mission_id, MissionState.ENDED) in _OVER


def _address(listener: socket.socket) -> str:
    host, port = listener.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _say(words: str) -> None:
    typer.echo(words, file=sys.stderr)
