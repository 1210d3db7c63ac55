"""Clients of one server: readers of its stream, browsers' consoles, and those that stall.

They speak as the real ones do (RFC 6455, Engine.IO 4 with Socket.IO inside, viser's protocol) and
do no more with what they get than they must, so that they take little of the machine. One that
stalls has finished its handshake and then never reads again, behind a small receive buffer.
"""

import asyncio
import base64
import json
import os
import re
import socket
import struct
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from urllib.parse import urlencode, urlsplit
from uuid import uuid4

import httpx
import viser
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

SMALL_BUFFER: Final = 4096
ACK_S: Final = 3.0
"""The console's page acknowledges what it has shown so often."""

OPEN_S: Final = 60.0
ESTABLISHED: Final = "01"
_STAMP: Final = re.compile(r'"stamp_s": ?([0-9.]+)')
_TICK: Final = re.compile(r'"tick": ?(\d+)')
_CLIENT: Final = re.compile(r"""["']client_id["']: ?["']([0-9a-f-]+)["']""")
_NEXT: Final = re.compile(r"""["']next_message_id["']: ?(\d+)""")

Headers = Mapping[str, str]


@dataclass(slots=True)
class Received:
    """What one client got."""

    messages: int = 0
    size: int = 0
    ages_s: list[float] = field(default_factory=list)
    """From the making of each snapshot to its receipt, one per tick."""

    ended: str = ""
    """Why its connection is over, "" while it is not."""


@asynccontextmanager
async def _socket(
    url: str, headers: Headers, protocol: str = ""
) -> AsyncIterator[ClientConnection]:
    protocols = [Subprotocol(protocol)] if protocol else None
    async with connect(
        url,
        additional_headers=headers,
        subprotocols=protocols,
        compression=None,
        max_size=None,
        open_timeout=OPEN_S,
        proxy=None,
    ) as opened:
        yield opened


async def read_stream(url: str, headers: Headers, got: Received) -> None:
    """Read a mission's stream until cancelled or closed; note the age of every snapshot."""
    last = -1
    try:
        async with _socket(url, headers) as stream:
            async for text in stream:
                now_s = time.monotonic()
                got.messages += 1
                got.size += len(text)
                assert isinstance(text, str)
                stamp, tick = _STAMP.search(text), _TICK.search(text)
                if stamp is None or tick is None or int(tick[1]) <= last:
                    continue
                if last >= 0:  # the first is the last one made before we came
                    got.ages_s.append(now_s - float(stamp[1]))
                last = int(tick[1])
        got.ended = "closed by the server"
    except (ConnectionClosed, OSError) as error:
        got.ended = str(error)


async def show_console(http: httpx.AsyncClient, headers: Headers, got: Received) -> None:
    """Open the console's page as a browser does and keep its socket until cancelled or closed."""
    try:
        url, client = await _page(http)
        async with _socket(url, headers) as page:
            acknowledged_s = time.monotonic()
            async for text in page:
                assert isinstance(text, str)
                got.messages += 1
                got.size += len(text)
                if text == "2":
                    await page.send("3")
                elif text.startswith("0"):
                    await page.send("40")
                elif time.monotonic() > acknowledged_s + ACK_S:
                    acknowledged_s = time.monotonic()
                    ack = {"client_id": client, "next_message_id": got.messages}
                    await page.send("42" + json.dumps(["ack", ack]))
        got.ended = "closed by the server"
    except (ConnectionClosed, OSError, httpx.HTTPError) as error:
        got.ended = str(error)


async def _page(http: httpx.AsyncClient) -> tuple[str, str]:
    """Fetch the page; return the address of its socket and its client's id."""
    page = (await http.get("/", headers={"accept": "text/html"})).raise_for_status().text
    client, following = _CLIENT.search(page), _NEXT.search(page)
    if client is None or following is None:
        raise httpx.RequestError("the console's page is not what it was")
    query = {
        "EIO": 4,
        "transport": "websocket",
        "client_id": client[1],
        "next_message_id": following[1],
        "implicit_handshake": "true",
        "tab_id": uuid4(),
        "document_id": uuid4(),
    }
    host = str(http.base_url).replace("http", "ws", 1).rstrip("/")
    return f"{host}/_nicegui_ws/socket.io/?{urlencode(query)}", client[1]


async def show_scene(url: str, headers: Headers, got: Received) -> None:
    """Watch the scene as the page's frame does, until cancelled or closed."""
    try:
        async with _socket(url, headers, f"viser-v{viser.__version__}") as scene:
            await scene.send(_camera())
            async for data in scene:
                got.messages += 1
                got.size += len(data)
        got.ended = "closed by the server"
    except (ConnectionClosed, OSError) as error:
        got.ended = str(error)


def _camera() -> bytes:
    """Return the message, in MessagePack, by which a scene's viewer says where it looks from."""
    return _packed(
        {
            "type": "ViewerCameraMessage",
            "wxyz": [1.0, 0.0, 0.0, 0.0],
            "position": [0.0, -10.0, 10.0],
            "fov": 1.0,
            "near": 0.01,
            "far": 1000.0,
            "image_height": 600,
            "image_width": 800,
            "look_at": [0.0, 0.0, 0.0],
            "up_direction": [0.0, 0.0, 1.0],
        }
    )


def _packed(value: object) -> bytes:
    """Return a value in MessagePack: what little of it a camera needs."""
    match value:
        case float():
            return b"\xcb" + struct.pack(">d", value)
        case int():
            return b"\xcd" + struct.pack(">H", value)
        case str():
            return bytes([0xA0 | len(value)]) + value.encode()
        case list():
            return bytes([0x90 | len(value)]) + b"".join(map(_packed, value))
        case dict():
            pairs = (_packed(part) for pair in value.items() for part in pair)
            return bytes([0x80 | len(value)]) + b"".join(pairs)
    raise TypeError(f"{value!r} is not packed here")


class Stalled:
    """A WebSocket that is opened and then never read."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link

    @classmethod
    async def open(
        cls, url: str, headers: Headers, protocol: str = "", first: str | bytes = ""
    ) -> "Stalled":
        """Open one; `first` is a message that it sends. Raises OSError, ConnectionError."""
        parts = urlsplit(url)
        loop = asyncio.get_running_loop()
        link = socket.socket()
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SMALL_BUFFER)
        link.settimeout(0.0)
        await loop.sock_connect(link, (parts.hostname, parts.port))
        path = f"{parts.path}?{parts.query}" if parts.query else parts.path
        lines = {
            "host": parts.netloc,
            "connection": "Upgrade",
            "upgrade": "websocket",
            "sec-websocket-version": "13",
            "sec-websocket-key": base64.b64encode(os.urandom(16)).decode(),
            **({"sec-websocket-protocol": protocol} if protocol else {}),
            **headers,
        }
        request = f"GET {path} HTTP/1.1\r\n" + "".join(f"{k}: {v}\r\n" for k, v in lines.items())
        await loop.sock_sendall(link, request.encode() + b"\r\n")
        async with asyncio.timeout(OPEN_S):
            answer = await loop.sock_recv(link, 16)
        if b" 101" not in answer:
            raise ConnectionError(f"the server answered {answer!r}")
        if first:
            await loop.sock_sendall(link, _frame(first))
        return cls(link)

    def dropped(self) -> bool:
        """Tell whether the server has given up on it: its end is no longer established.

        Our own end cannot know, since what was sent before waits unread.
        """
        ours, theirs = self._link.getsockname()[1], self._link.getpeername()[1]
        for line in Path("/proc/net/tcp").read_text("ascii").splitlines()[1:]:
            near, far, state = line.split()[1:4]
            if (int(near[-4:], 16), int(far[-4:], 16)) == (theirs, ours):
                return state != ESTABLISHED
        return True

    def close(self) -> None:
        """Go."""
        self._link.close()


def _frame(message: str | bytes) -> bytes:
    """Return a short message in a frame, masked as a client must."""
    kind, payload = (b"\x81", message.encode()) if isinstance(message, str) else (b"\x82", message)
    mask = os.urandom(4)
    masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload))
    length = len(payload)
    head = bytes([0x80 | length]) if length < 126 else b"\xfe" + length.to_bytes(2, "big")
    return kind + head + mask + masked


async def stalled_stream(url: str, headers: Headers) -> Stalled:
    """Return a reader of the stream that reads nothing."""
    return await Stalled.open(url, headers)


async def stalled_console(http: httpx.AsyncClient, headers: Headers) -> Stalled:
    """Return a console whose browser has frozen."""
    url, _ = await _page(http)
    return await Stalled.open(url, headers, first="40")


async def stalled_scene(url: str, headers: Headers) -> Stalled:
    """Return a scene's viewer that has frozen."""
    return await Stalled.open(url, headers, f"viser-v{viser.__version__}", _camera())
