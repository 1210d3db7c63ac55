"""Serves the console over a scripted mission, as a process of its own: NiceGUI has one app each.

Prints the port on standard output, ends when standard input ends.
"""

import asyncio
import sys

import uvicorn

from console.page import mount
from server.api.app import create_app
from server.api.models import MissionRequest
from server.api.web import web_config
from server.logs import configure_logs
from server.settings import Settings
from tests.server.api.serving import Stage
from tests.server.waiting import eventually


async def main() -> None:
    """Serve until the parent goes."""
    configure_logs()
    stage = Stage(period_s=0.1)
    settings = Settings(port=0)
    server = uvicorn.Server(web_config(create_app(settings, stage.service, mount), settings))
    serving = asyncio.create_task(server.serve())
    await eventually(lambda: server.started, within_s=60.0)
    await stage.service.create(MissionRequest(scenario="scripted"))
    await stage.service.start("m1", "operator")
    sys.stdout.write(f"{server.servers[0].sockets[0].getsockname()[1]}\n")
    sys.stdout.flush()
    await asyncio.to_thread(sys.stdin.read)
    server.should_exit = True
    await serving


if __name__ == "__main__":
    asyncio.run(main())
