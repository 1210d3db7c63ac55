"""Views of the scene: whose they are, whose clicks are heard, where their cameras look."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace

import httpx
import pytest
import viser
from fastapi import FastAPI
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send
from viser import _messages
from viser.infra import _messages as wire
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

from console.camera import whole_field
from console.pencil import Ellipse, Pencil
from console.picture import team_centre
from console.proxy import add_scene_routes
from console.scene import SECRET_HEADER, VIEWER_HEADER, Scene, open_scene
from console.viewers import NOBODY, Viewers
from server.api.identity import Identity, Role
from tests.console.messages import message
from tests.server.api.serving import served
from tests.server.waiting import eventually

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")


@pytest.fixture
def scene() -> Iterator[Scene]:
    scene = open_scene()
    yield scene
    scene.close()


def test_a_view_is_known_by_its_page_only() -> None:
    viewers = Viewers()
    ada, bob = Identity("ada", Role.OPERATOR, "s1"), Identity("bob", Role.VIEWER, "s2")
    page = viewers.enter(ada)
    assert viewers.name_for(page, ada) == page
    assert viewers.name_for(page, bob) == NOBODY
    assert viewers.name_for(page, Identity("ada", Role.OPERATOR, "s3")) == NOBODY
    assert viewers.name_for("guess", ada) == NOBODY
    assert viewers.enter(ada) != page
    viewers.leave(page)
    assert viewers.name_for(page, ada) == NOBODY


@asynccontextmanager
async def view(scene: Scene, page: str) -> AsyncIterator[ClientConnection]:
    """A browser's view of the scene, as the proxy opens it; it has said where its camera is."""
    headers = {SECRET_HEADER: scene.secret, VIEWER_HEADER: page}
    async with connect(
        f"ws://127.0.0.1:{scene.port}/",
        subprotocols=[PROTOCOL],
        additional_headers=headers,
        proxy=None,
        max_size=None,
    ) as socket:
        reading = asyncio.create_task(_drain(socket))
        await socket.send(said(CAMERA))
        await eventually(lambda: scene.watched)
        yield socket
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)


async def _drain(socket: ClientConnection) -> None:
    async for _ in socket:
        pass


CAMERA = _messages.ViewerCameraMessage(
    wxyz=(1.0, 0.0, 0.0, 0.0),
    position=(0.0, -10.0, 10.0),
    fov=1.0,
    near=0.1,
    far=100.0,
    image_height=600,
    image_width=800,
    look_at=(0.0, 0.0, 0.0),
    up_direction=(0.0, 0.0, 1.0),
)
CLICK = _messages.ScenePointerMessage(
    "click", (0.0, -10.0, 10.0), (0.0, 1.0, -1.0), ((0.5, 0.5),), None
)


def said(message: _messages.Message) -> bytes:
    """A message as viser's own script sends it."""
    packed: bytes = wire.msgspec.msgpack.encode(message.as_serializable_dict())  # type: ignore[attr-defined]
    return packed


@pytest.mark.asyncio
async def test_only_the_view_of_the_page_that_draws_is_listened_to(scene: Scene) -> None:
    clicks: list[tuple[object, object]] = []
    pencil = Pencil(lambda: scene.view("mine"), lambda *ray: clicks.append(ray))
    assert not pencil.take()
    async with (
        view(scene, "theirs") as theirs,
        view(scene, "mine") as mine,
        view(scene, "") as blank,
    ):
        await eventually(lambda: len(scene._server.get_clients()) == 3)
        assert scene.view("") is None
        assert pencil.take()
        for socket in (theirs, blank, mine):
            await socket.send(said(CLICK))
            await socket.send(said(replace(CAMERA, position=(5.0, 5.0, 5.0))))
        clients = scene._server.get_clients().values()
        await eventually(lambda: all(c.camera.position[0] == 5.0 for c in clients))
        await eventually(lambda: bool(clicks))
        assert clicks == [(CLICK.ray_origin, CLICK.ray_direction)]
        pencil.show(Ellipse((1.0, 2.0), (2.0, 1.0), 0.5, "sensing"), 0.2)
        pencil.show(Ellipse((1.0, 2.0), None, 0.0, "communication"), 0.2)
        pencil.lay_down()
        assert not pencil.held
    pencil.take()
    await eventually(lambda: not pencil.held)


@pytest.mark.asyncio
async def test_a_view_that_changes_its_shape_is_fitted_again_until_somebody_moves_it(
    scene: Scene,
) -> None:
    async with view(scene, "mine") as socket:
        await eventually(lambda: scene.view("mine") is not None)
        shown = scene.view("mine")
        assert shown is not None
        scene.draw(message(30.0))
        for width in (1600, 400):
            place, _ = whole_field(
                message(30.0), shown.camera.aspect, CAMERA.fov, CAMERA.image_height
            )
            assert shown.camera.position.tolist() == pytest.approx(place)
            resized = replace(CAMERA, position=place, image_width=width)
            await socket.send(said(resized))
            await eventually(lambda width=width: shown.camera.image_width == width)  # type: ignore[misc]
            scene.draw(message(30.0))
        await socket.send(said(replace(CAMERA, position=(9.0, 9.0, 9.0), image_width=900)))
        await eventually(lambda: shown.camera.image_width == 900)
        scene.draw(message(30.0))
        assert shown.camera.position.tolist() == [9.0, 9.0, 9.0]


@pytest.mark.asyncio
async def test_a_camera_fits_the_field_and_goes_with_the_team(scene: Scene) -> None:
    scene.draw(message(30.0))
    async with view(scene, "mine"):
        await eventually(lambda: scene.view("mine") is not None)
        shown = scene.view("mine")
        assert shown is not None
        assert scene.fit("mine", message(30.0))
        position, look_at = whole_field(message(30.0), 800 / 600, CAMERA.fov, 600)
        assert shown.camera.position.tolist() == pytest.approx(position)
        assert shown.camera.look_at.tolist() == pytest.approx(look_at)
        scene.follow("mine")
        for time_s in (30.0, 60.0):
            scene.draw(message(time_s))
            assert shown.camera.look_at[:2].tolist() == pytest.approx(team_centre(message(time_s)))
        scene.leave("mine")
        scene.draw(message(90.0))
        assert shown.camera.look_at[:2].tolist() == pytest.approx(team_centre(message(60.0)))
    assert not scene.fit("nobody", message(30.0))


class Introduced:
    """Stands where the doorkeeper stands: everybody is who a header says."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in {"http", "websocket"}:
            name = Headers(scope=scope).get("x-name", "nobody")
            scope["identity"] = Identity(name, Role.OPERATOR, f"session of {name}")
        await self._app(scope, receive, send)


@pytest.mark.asyncio
async def test_behind_the_proxy_a_page_is_borne_by_its_own_session_only(scene: Scene) -> None:
    viewers = Viewers()
    page = viewers.enter(Identity("ada", Role.OPERATOR, "session of ada"))
    app = FastAPI()
    app.add_middleware(Introduced)
    add_scene_routes(app, lambda: scene, viewers)

    async with served(app) as address, AsyncExitStack() as stack:
        for seen, name in enumerate(("bob", "ada"), start=1):
            socket = await stack.enter_async_context(
                connect(
                    f"ws://{address}/scene/{page}",
                    subprotocols=[PROTOCOL],
                    additional_headers={"x-name": name},
                    proxy=None,
                    max_size=None,
                )
            )
            stack.callback(asyncio.create_task(_drain(socket)).cancel)
            await socket.send(said(CAMERA))
            await eventually(lambda seen=seen: len(scene._server.get_clients()) == seen)  # type: ignore[misc]
            assert (scene.view(page) is not None) == (name == "ada")
        async with httpx.AsyncClient(base_url=f"http://{address}") as browser:
            answer = await browser.get(f"/scene/{page}/")
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/html")
