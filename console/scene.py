"""The 3D scene: a viser server on loopback, drawn from snapshot messages.

Nobody reaches it but our own proxy (console.proxy): it listens on a free port of 127.0.0.1 and
closes every connection that does not carry this process's secret. Its handlers that would open
a public tunnel on anybody's request are taken out.
"""

import hmac
import secrets
from typing import Any

import numpy as np
import rich
import viser
from viser import _messages, infra

from console import picture
from console.camera import Lens, Point3, whole_field
from console.labels import Declutter, leaders
from console.layers import Labels, Lines, Signs
from console.picture import LineData, SignData, Trails
from console.shapes import Floats, diamond, disc, drone, moved, ring

SECRET_HEADER = "x-falconer-scene"
VIEWER_HEADER = "x-falconer-viewer"
"""Carries the name of the page whose view it is (`console.viewers`)."""

CLOSE_POLICY = 1008

OTHER_SHAPE = 0.03
"""A view whose aspect differs by more, relatively, has another shape."""

MOVED = 0.02
"""A camera farther from where it was put, relative to its height, was moved by somebody."""

_SIGNS = {
    "zones": (disc(), 0.30),
    "undiscovered": (disc(), 0.16),
    "clouds": (disc(), 1.0),
    "uncertainties": (ring(0.90), 0.9),
    "targets": (diamond(), 1.0),
    "true_targets": (diamond(), 0.7),
    "robots": (drone(), 1.0),
    "failures": (ring(0.86), 0.9),
    "waypoints": (ring(0.6), 1.0),
    "pins": (ring(0.5), 1.0),
}
_RIM_LIFT = (0.0, 0.0, 0.03)  # above the disc, or the two would flicker through each other
_RIMS = {
    "zone_rims": moved(ring(0.975), _RIM_LIFT),
    "undiscovered_rims": moved(ring(0.98), _RIM_LIFT),
}
_LINES = {
    "field": 1.0,
    "stalks": 1.0,
    "trails": 1.5,
    "paths": 2.5,
    "ways": 2.0,
    "assignment": 1.5,
    "pinned": 4.5,
    "leaders": 1.0,
}


class Scene:
    """Owner of the viser server and of what it shows. Made by `open_scene`."""

    def __init__(self, server: viser.ViserServer, secret: str, views: dict[int, str]) -> None:
        self._server = server
        self.secret = secret
        self._views = views
        api = server.scene
        self._signs = {
            name: Signs(api, f"/{name}", mesh, opacity) for name, (mesh, opacity) in _SIGNS.items()
        } | {name: Signs(api, f"/{name}", mesh, 0.9) for name, mesh in _RIMS.items()}
        self._lines = {name: Lines(api, f"/{name}", width) for name, width in _LINES.items()}
        self._labels = Labels(api, "/labels")
        self._declutter = Declutter()
        self._fits: dict[str, tuple[float, Point3]] = {}
        self._first: Point3 = (0.0, 0.0, 0.0)
        self._lens = Lens.at((0.0, -1.0, 1.0), self._first)
        self._followed: dict[str, tuple[float, float] | None] = {}
        self._trails = Trails()
        self._field: Any = None
        self._mission: str | None = None

    @property
    def port(self) -> int:
        """The port on 127.0.0.1."""
        return int(self._server.get_port())

    @property
    def watched(self) -> bool:
        """Whether any browser shows the scene."""
        return bool(self._server.get_clients())

    def view(self, page: str) -> viser.ClientHandle | None:
        """Return the newest view of one page, None where it shows no scene."""
        clients = self._server.get_clients()
        own = [number for number in clients if page and self._views.get(number) == page]
        return clients[max(own)] if own else None

    def fit(self, page: str, snapshot: dict[str, Any]) -> bool:
        """Point a page's camera at the whole field; False where it shows no scene."""
        self._followed.pop(page, None)
        view = self.view(page)
        if view is None:
            return False
        self._point(page, view, snapshot)
        return True

    def follow(self, page: str) -> None:
        """Let a page's camera go with the team from now on."""
        self._followed[page] = None

    def leave(self, page: str) -> None:
        """Let a page's camera stay where it is."""
        self._followed.pop(page, None)

    def follows(self, page: str) -> bool:
        """Whether a page's camera goes with the team."""
        return page in self._followed

    def note(self, snapshot: dict[str, Any]) -> None:
        """Take a snapshot for the trails, whether anybody watches or not."""
        if snapshot["mission"] != self._mission:
            self._mission = snapshot["mission"]
            self._trails = Trails()
        self._trails.note(snapshot)

    def draw(self, snapshot: dict[str, Any]) -> None:
        """Show a snapshot in every browser. A few milliseconds; does not block."""
        with self._server.atomic():
            if snapshot["field"] != self._field:
                self._lay_out(snapshot)
            known, hidden = picture.zones(snapshot), picture.undiscovered(snapshot)
            shown: dict[str, SignData] = {
                "zones": known,
                "zone_rims": known,
                "clouds": picture.clouds(snapshot),
                "undiscovered": hidden,
                "undiscovered_rims": hidden,
                "uncertainties": picture.uncertainties(snapshot),
                "targets": picture.targets(snapshot),
                "true_targets": picture.true_targets(snapshot),
                "robots": picture.robots(snapshot),
                "failures": picture.failures(snapshot),
                "waypoints": picture.waypoints(snapshot),
                "pins": picture.pins(snapshot),
            }
            for name, signs in shown.items():
                self._signs[name].show(
                    signs.positions, signs.wxyzs, signs.scales, signs.colours, signs.opacities
                )
            labels = picture.labels(snapshot)
            placed = self._declutter.place(labels, self._lens)
            drawn: dict[str, LineData] = {
                "stalks": picture.stalks(snapshot),
                "trails": self._trails.lines(),
                "paths": picture.predicted_paths(snapshot),
                "ways": picture.waypoint_lines(snapshot),
                "assignment": picture.assignment_lines(snapshot),
                "pinned": picture.pinned_lines(snapshot),
                "leaders": picture.leader_lines(leaders(labels, placed)),
            }
            for name, lines in drawn.items():
                self._lines[name].show(lines.points, lines.colours)
            self._labels.show({key: (p.text, p.position) for key, p in placed.items()})
        self._keep_fitted(snapshot)
        self._go_along(snapshot)

    def close(self) -> None:
        """Stop the server. Blocks for a moment."""
        self._server.stop()

    def _point(self, page: str, view: viser.ClientHandle, snapshot: dict[str, Any]) -> None:
        """Let one view show the whole field."""
        camera = view.camera
        position, look_at = whole_field(snapshot, camera.aspect, camera.fov, camera.image_height)
        self._fits[page] = (camera.aspect, position)
        with view.atomic():
            camera.position = position
            camera.look_at = look_at

    def _keep_fitted(self, snapshot: dict[str, Any]) -> None:
        """Fit the field into each view that opens, or changes its shape before anybody moved it."""
        pages = set(self._views.values())
        for page in pages:
            view = self.view(page)
            if view is None:
                continue
            fit = self._fits.get(page)
            if fit is None:
                self._point(page, view, snapshot)
                continue
            aspect, position = fit
            changed = abs(view.camera.aspect - aspect) > OTHER_SHAPE * aspect
            stands = _close(view.camera.position, position)
            # A browser may take up the first pose after it was told a better one.
            if _close(view.camera.position, self._first) or (changed and stands):
                self._point(page, view, snapshot)
        self._fits = {page: fit for page, fit in self._fits.items() if page in pages}

    def _go_along(self, snapshot: dict[str, Any]) -> None:
        """Move the cameras that follow the team as far as it has moved."""
        centre = picture.team_centre(snapshot)
        if centre is None:
            return
        for page, before in self._followed.items():
            view = self.view(page)
            self._followed[page] = centre
            if view is None:
                continue
            if before is None:
                gone = (*centre, 0.0) - view.camera.look_at
                gone[2] = 0.0
            else:
                gone = np.array([centre[0] - before[0], centre[1] - before[1], 0.0])
            with view.atomic():
                view.camera.position = view.camera.position + gone

    def _lay_out(self, snapshot: dict[str, Any]) -> None:
        """Draw the field and point new cameras at it."""
        self._field = snapshot["field"]
        grid = picture.field_grid(snapshot)
        self._lines["field"].show(grid.points, grid.colours)
        position, look_at = whole_field(snapshot)
        self._first = position
        self._lens = Lens.at(position, look_at)
        self._server.initial_camera.position = position
        self._server.initial_camera.look_at = look_at


def _close(place: Floats, wanted: Point3) -> bool:
    """Tell whether a camera stands where it was put."""
    return bool(np.linalg.norm(place - wanted) <= MOVED * abs(wanted[2]))


def open_scene() -> Scene:
    """Start a viser server and return the scene. Blocks; call it in a thread."""
    # It announces itself, and its end, through rich's own console on standard output.
    rich.get_console().quiet = True
    server = viser.ViserServer(host="127.0.0.1", port=0)
    socket = server._websock_server
    for share in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        socket.unregister_handler(share)
    secret = secrets.token_urlsafe(32)
    views: dict[int, str] = {}
    _admit_only(socket, secret, views)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    _light(server.scene)
    return Scene(server, secret, views)


def _light(scene: viser.SceneApi) -> None:
    """Light the scene evenly, so that colours look as they are meant."""
    scene.world_axes.visible = False
    scene.configure_environment_map(None)
    scene.configure_default_lights(enabled=False, cast_shadow=False)
    scene.add_light_ambient("/lights/all", intensity=2.4)
    scene.add_light_directional("/lights/sun", intensity=1.2, position=(-3.0, -5.0, 9.0))


def _admit_only(socket: infra.WebsockServer, secret: str, views: dict[int, str]) -> None:
    """Close each connection that does not bring the secret; note whose view each other one is."""

    async def check(client: infra.WebsockClientConnection) -> None:
        connection = socket._live_connections[client.client_id]
        request = connection.request
        given = "" if request is None else request.headers.get(SECRET_HEADER, "")
        if not hmac.compare_digest(given.encode(), secret.encode()):
            await connection.close(CLOSE_POLICY, "not the console")
        elif request is not None:
            views[client.client_id] = request.headers.get(VIEWER_HEADER, "")

    async def forget(client: infra.WebsockClientConnection) -> None:
        views.pop(client.client_id, None)

    socket.on_client_connect(check)
    socket.on_client_disconnect(forget)
