"""Serves the console over a scripted mission, as a process of its own: NiceGUI has one app each.

Prints the port on standard output, ends when standard input ends.
"""

import asyncio
import sys

import uvicorn

from console.page import mount
from server.api.models import MissionRequest
from server.api.web import web_config
from server.logs import configure_logs
from server.settings import Settings
from tests.server.api.serving import Stage


async def main() -> None:
    """Serve until the parent goes."""
    configure_logs()
    stage = Stage(period_s=0.1)
    from server.api.app import create_app

    settings = Settings(port=0)
    app = create_app(settings, stage.service, mount)
    server = uvicorn.Server(web_config(app, settings))
    serving = asyncio.create_task(server.serve())
    while not server.started and not serving.done():
        await asyncio.sleep(0.01)
    await stage.service.create(MissionRequest(scenario="scripted"))
    await stage.service.start("m1", "operator")
    print(server.servers[0].sockets[0].getsockname()[1], flush=True)
    await asyncio.to_thread(sys.stdin.read)
    server.should_exit = True
    await serving


if __name__ == "__main__":
    asyncio.run(main())
