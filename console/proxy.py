"""The scene under our own origin: its one page at /scene/, its WebSocket at /scene and /scene/.

What passes here has passed the doorkeeper like every other request, so the scene is never
exposed on its own.
"""

import asyncio
import gzip
from collections.abc import Callable
from pathlib import Path

import structlog
import viser
from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import Response
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from console.scene import SECRET_HEADER, VIEWER_HEADER, Scene
from console.viewers import NOBODY, Viewers
from server.api.identity import identity_of

log = structlog.get_logger(__name__)

PAGE = Path(viser.__file__).parent / "client" / "build" / "index.html"
PROTOCOL_PREFIX = "viser-v"
MAX_UP_BYTES = 256 * 1024
"""What a browser may send at once: camera poses and pointer events are small."""

CLOSE_TRY_LATER = 1013
CLOSE_TOO_BIG = 1009

HOUSE_STYLE = """<style>
html, body, #root, #root div:has(> div > [data-dock-root]) { background: transparent !important; }
.mantine-Notifications-root, .mantine-Paper-root, [data-floating-window] {
  display: none !important;
}
</style>"""


def add_scene_routes(app: FastAPI, scene: Callable[[], Scene | None], viewers: Viewers) -> None:
    """Serve the scene's page and pass its WebSocket through.

    Below `/scene/PAGE/` it is the view of one page of the console, below `/scene/` nobody's.
    viser's own script takes the WebSocket's address from that of its page.
    """
    page = PAGE.read_bytes().replace(b"</head>", HOUSE_STYLE.encode() + b"</head>", 1)
    packed = gzip.compress(page, 6)

    async def serve_page(request: Request) -> Response:
        if "gzip" in request.headers.get("accept-encoding", ""):
            return Response(packed, media_type="text/html", headers={"content-encoding": "gzip"})
        return Response(page, media_type="text/html")

    async def pass_through(websocket: WebSocket) -> None:
        shown = scene()
        offered = websocket.scope.get("subprotocols", [])
        protocol = next((p for p in offered if p.startswith(PROTOCOL_PREFIX)), None)
        if shown is None or protocol is None:
            await websocket.close(CLOSE_TRY_LATER, "the scene is not there")
            return
        page = websocket.path_params.get("page", NOBODY)
        view = viewers.name_for(page, identity_of(websocket))
        await _bridge(websocket, shown, protocol, view)

    for path in ("/scene/", "/scene/{page}/"):
        app.add_route(path, serve_page, methods=["GET"], include_in_schema=False)
        app.add_api_websocket_route(path.rstrip("/"), pass_through)
        app.add_api_websocket_route(path, pass_through)


async def _bridge(websocket: WebSocket, scene: Scene, protocol: str, view: str) -> None:
    """Carry messages both ways until either side ends; `view` names the page it belongs to."""
    upstream = connect(
        f"ws://127.0.0.1:{scene.port}/",
        subprotocols=[Subprotocol(protocol)],
        additional_headers={SECRET_HEADER: scene.secret, VIEWER_HEADER: view},
        compression=None,
        max_size=None,
        proxy=None,
    )
    try:
        async with upstream as connection:
            await websocket.accept(subprotocol=protocol)
            ways = {
                asyncio.create_task(_down(connection, websocket)),
                asyncio.create_task(_up(websocket, connection)),
            }
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)
    except (OSError, InvalidHandshake) as error:
        log.warning("the scene cannot be reached", error=str(error))
        await websocket.close(CLOSE_TRY_LATER, "the scene is not there")


async def _down(connection: ClientConnection, websocket: WebSocket) -> None:
    """Carry the scene to the browser; the browser's pace is the scene's pace."""
    try:
        async for message in connection:
            if isinstance(message, bytes):
                await websocket.send_bytes(message)
            else:
                await websocket.send_text(message)
        await websocket.close()
    except (ConnectionClosed, WebSocketDisconnect, RuntimeError):
        return


async def _up(websocket: WebSocket, connection: ClientConnection) -> None:
    """Carry camera poses and clicks to the scene."""
    try:
        while True:
            message = await websocket.receive()
            if message["type"] == "websocket.disconnect":
                return
            data = message.get("bytes") or message.get("text") or b""
            if len(data) > MAX_UP_BYTES:
                await websocket.close(CLOSE_TOO_BIG, "too much at once")
                return
            await connection.send(data)
    except (ConnectionClosed, WebSocketDisconnect):
        return
