"""The 3D scene: a viser server on loopback, drawn from snapshot messages.

Nobody reaches it but our own proxy (console.proxy): it listens on a free port of 127.0.0.1 and
closes every connection that does not carry this process's secret. Its handlers that would open
a public tunnel on anybody's request are taken out.
"""

import hmac
import secrets
from typing import Any

import rich
import viser
from viser import _messages, infra

from console import picture
from console.layers import Labels, Lines, Signs
from console.picture import LineData, SignData, Trails
from console.shapes import diamond, disc, drone, moved, ring

SECRET_HEADER = "x-falconer-scene"
CLOSE_POLICY = 1008

_SIGNS = {
    "zones": (disc(), 0.30),
    "undiscovered": (disc(), 0.16),
    "uncertainties": (ring(0.90), 0.9),
    "targets": (diamond(), 1.0),
    "true_targets": (diamond(), 0.7),
    "robots": (drone(), 1.0),
    "failures": (ring(0.86), 0.9),
    "waypoints": (diamond(), 0.8),
}
_RIM_LIFT = (0.0, 0.0, 0.03)  # above the disc, or the two would flicker through each other
_RIMS = {
    "zone_rims": moved(ring(0.975), _RIM_LIFT),
    "undiscovered_rims": moved(ring(0.98), _RIM_LIFT),
}
_LINES = {"field": 1.0, "stalks": 1.0, "trails": 1.5, "assignment": 2.0}


class Scene:
    """Owner of the viser server and of what it shows. Made by `open_scene`."""

    def __init__(self, server: viser.ViserServer, secret: str) -> None:
        self._server = server
        self.secret = secret
        api = server.scene
        self._signs = {
            name: Signs(api, f"/{name}", mesh, opacity) for name, (mesh, opacity) in _SIGNS.items()
        } | {name: Signs(api, f"/{name}", mesh, 0.9) for name, mesh in _RIMS.items()}
        self._lines = {name: Lines(api, f"/{name}", width) for name, width in _LINES.items()}
        self._labels = Labels(api, "/labels")
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
                "undiscovered": hidden,
                "undiscovered_rims": hidden,
                "uncertainties": picture.uncertainties(snapshot),
                "targets": picture.targets(snapshot),
                "true_targets": picture.true_targets(snapshot),
                "robots": picture.robots(snapshot),
                "failures": picture.failures(snapshot),
                "waypoints": picture.waypoints(snapshot),
            }
            for name, signs in shown.items():
                self._signs[name].show(signs.positions, signs.wxyzs, signs.scales, signs.colours)
            drawn: dict[str, LineData] = {
                "stalks": picture.stalks(snapshot),
                "trails": self._trails.lines(),
                "assignment": picture.assignment_lines(snapshot),
            }
            for name, lines in drawn.items():
                self._lines[name].show(lines.points, lines.colours)
            self._labels.show(picture.labels(snapshot))

    def close(self) -> None:
        """Stop the server. Blocks for a moment."""
        self._server.stop()

    def _lay_out(self, snapshot: dict[str, Any]) -> None:
        """Draw the field and point new cameras at it."""
        self._field = snapshot["field"]
        grid = picture.field_grid(snapshot)
        self._lines["field"].show(grid.points, grid.colours)
        position, look_at = picture.camera(snapshot)
        self._server.initial_camera.position = position
        self._server.initial_camera.look_at = look_at


def open_scene() -> Scene:
    """Start a viser server and return the scene. Blocks; call it in a thread."""
    # It announces itself, and its end, through rich's own console on standard output.
    rich.get_console().quiet = True
    server = viser.ViserServer(host="127.0.0.1", port=0)
    socket = server._websock_server
    for share in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        socket.unregister_handler(share)
    secret = secrets.token_urlsafe(32)
    _admit_only(socket, secret)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    _light(server.scene)
    return Scene(server, secret)


def _light(scene: viser.SceneApi) -> None:
    """Light the scene evenly, so that colours look as they are meant."""
    scene.world_axes.visible = False
    scene.configure_environment_map(None)
    scene.configure_default_lights(enabled=False, cast_shadow=False)
    scene.add_light_ambient("/lights/all", intensity=2.4)
    scene.add_light_directional("/lights/sun", intensity=1.2, position=(-3.0, -5.0, 9.0))


def _admit_only(socket: infra.WebsockServer, secret: str) -> None:
    """Close each connection that does not bring the secret."""

    async def check(client: infra.WebsockClientConnection) -> None:
        connection = socket._live_connections[client.client_id]
        request = connection.request
        given = "" if request is None else request.headers.get(SECRET_HEADER, "")
        if not hmac.compare_digest(given.encode(), secret.encode()):
            await connection.close(CLOSE_POLICY, "not the console")

    socket.on_client_connect(check)
