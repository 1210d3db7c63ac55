"""The scene's own server listens to nobody but the proxy."""

import asyncio
from collections.abc import Iterator

import pytest
import viser
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from console.proxy import HOUSE_STYLE, PAGE
from console.scene import CLOSE_POLICY, SECRET_HEADER, Scene, open_scene
from tests.console.messages import message
from tests.patience import PATIENCE_S

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")


@pytest.fixture
def scene() -> Iterator[Scene]:
    scene = open_scene()
    yield scene
    scene.close()


def url(scene: Scene) -> str:
    return f"ws://127.0.0.1:{scene.port}/"


@pytest.mark.asyncio
@pytest.mark.parametrize("headers", [{}, {SECRET_HEADER: "guess"}])
async def test_a_stranger_is_closed_out(scene: Scene, headers: dict[str, str]) -> None:
    async with connect(
        url(scene), subprotocols=[PROTOCOL], additional_headers=headers, proxy=None
    ) as socket:
        with pytest.raises(ConnectionClosed) as closed:
            async with asyncio.timeout(PATIENCE_S):
                await read_on(socket)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == CLOSE_POLICY


async def read_on(socket: object) -> None:
    while True:
        await socket.recv()  # type: ignore[attr-defined]


@pytest.mark.asyncio
async def test_the_proxy_is_let_in_and_gets_the_picture(scene: Scene) -> None:
    scene.draw(message())
    headers = {SECRET_HEADER: scene.secret}
    async with connect(
        url(scene),
        subprotocols=[PROTOCOL],
        additional_headers=headers,
        proxy=None,
        max_size=None,
    ) as socket:
        async with asyncio.timeout(PATIENCE_S):
            first = await socket.recv()
    assert isinstance(first, bytes)
    assert len(first) > 100


def test_nobody_can_ask_for_a_public_tunnel(scene: Scene) -> None:
    handlers = scene._server._websock_server._incoming_handlers
    assert not [kind for kind in handlers if "Share" in kind.__name__]


def test_the_same_scene_is_drawn_again_and_again(scene: Scene) -> None:
    for tick in range(30):
        said = message(0.1 * tick)
        if tick % 3 == 0:
            said["zones"] = said["zones"][:1]
        if tick % 5 == 0:
            said["targets"][0]["position"] = None
        scene.note(said)
        scene.draw(said)


def test_the_viewers_page_is_one_file_that_takes_our_style() -> None:
    page = PAGE.read_text("utf-8")
    assert page.count("</head>") == 1
    assert "[data-floating-window]" in HOUSE_STYLE
