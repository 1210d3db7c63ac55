"""Serves the console over a scripted mission, as a process of its own: NiceGUI has one app each.

Prints the port on standard output, ends when standard input ends. With `--closed` one has to log
in, and the path of a one-time link stands behind the port. With `--confirm` proposals wait for
a person. One alarm stands from the start.
"""

import asyncio
import sys

import uvicorn
from pydantic import SecretStr

from console.page import mount
from server.api.access import Access
from server.api.app import create_app
from server.api.identity import Role
from server.api.models import MissionRequest
from server.api.web import web_config
from server.encoding import EventKind, Severity
from server.mission.setup import GateMode
from server.settings import Settings
from tests.server.api.serving import OpenDoor, Stage
from tests.server.waiting import eventually
from vehicles.logs import configure_logs

VIEWER = SecretStr("viewer-token-of-the-stage")


async def main() -> None:
    """Serve until the parent goes."""
    configure_logs()
    stage = Stage(period_s=0.1)
    settings = Settings(port=0, viewer_token=VIEWER)
    closed = Access(settings)
    door = closed if "--closed" in sys.argv else OpenDoor()
    app = create_app(settings, stage.service, mount, door)
    server = uvicorn.Server(web_config(app, settings))
    serving = asyncio.create_task(server.serve())
    await eventually(lambda: server.started)
    gate = GateMode.CONFIRM if "--confirm" in sys.argv else None
    await stage.service.create(MissionRequest(scenario="scripted", gate=gate), "operator")
    await stage.service.start("m1", "operator")
    stage.planners[0].event(
        EventKind.LINK, Severity.WARNING, "Robot 31 is silent.", robot=31, link="jammed"
    )
    link = f" {closed.link(Role.OPERATOR)}" if door is closed else ""
    sys.stdout.write(f"{server.servers[0].sockets[0].getsockname()[1]}{link}\n")
    sys.stdout.flush()
    await asyncio.to_thread(sys.stdin.read)
    server.should_exit = True
    await serving


if __name__ == "__main__":
    asyncio.run(main())
