"""What every request passes before anything else looks at it. Pure ASGI.

Why so: a page elsewhere must not be able to use an operator's browser as its arm, and nobody may
see or steer who has not shown who they are. In this order:

1. *Host*. Without tokens the Host header must name this machine: a foreign name that resolves to
   127.0.0.1 (DNS rebinding) is refused, for reads too.
2. *Origin*. Whoever changes something or opens a WebSocket from a browser must come from our own
   page: its Origin header must equal the address it asks. Programs send no Origin and pass here.
3. *Identity*. A token in the Authorization header, which no foreign page can set, or the signed
   cookie of a session (server.api.sessions), which is never sent along from elsewhere.
4. *Role*, by method and path (server.api.identity).
5. *CSRF*. A change by cookie must say where it comes from, and below /api carry the session's
   token, which only our own page can read.

As middleware around the whole application this covers REST, the stream, the console's own
socket and the scene alike.
"""

import hmac
import ipaddress
from collections.abc import Callable, Iterable
from http import HTTPStatus
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from server.api.access import Door
from server.api.errors import ServiceError, error_response
from server.api.identity import SAFE_METHODS, Identity, needed_role
from server.errors import BadInput

MAX_BODY_BYTES = 64 * 1024

LOGIN_PATH: Final = "/login"
CLOSE_LOGGED_OUT: Final = 4401

OPEN_PATHS: Final = frozenset({"/healthz", "/readyz", LOGIN_PATH})
"""Answer to everybody: whether the server lives, and the way in."""

OPEN_REQUESTS: Final = frozenset({("POST", "/api/v1/session")})
"""Logging in, of course, needs no login."""

CONTENT_SECURITY_POLICY: Final = "; ".join(
    (
        "default-src 'self'",
        "script-src 'self' 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob:",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data: blob:",
        "font-src 'self' data:",
        "connect-src 'self' data: blob:",
        "worker-src 'self' blob:",
        "frame-ancestors 'self'",
        "base-uri 'self'",
        "form-action 'self'",
        "object-src 'none'",
    )
)

SECURITY_HEADERS: Final = {
    "content-security-policy": CONTENT_SECURITY_POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "SAMEORIGIN",
    "referrer-policy": "same-origin",  # with none at all, forms send the origin "null"
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


class ExposureRefused(BadInput):
    """Raised when the server would be reachable from elsewhere without tokens."""


def is_loopback(host: str) -> bool:
    """Tell whether a host name or address, without a port, is this machine's loopback."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def check_exposure(host: str, tokens: Iterable[str]) -> None:
    """Raise ExposureRefused when `host` is not loopback and there is no token."""
    if not is_loopback(host) and not any(tokens):
        raise ExposureRefused(
            f"Refusing to listen on {host} without a token. Set FALCONER_OPERATOR_TOKEN"
            " (and FALCONER_VIEWER_TOKEN), or listen on 127.0.0.1."
        )


class Doorkeeper:
    """Checks Host, Origin, identity, role and CSRF token; adds headers."""

    def __init__(self, app: ASGIApp, *, door: Door) -> None:
        self._app = app
        self._door = door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a connection on, or refuse it."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        scope.pop("identity", None)
        refusal = self._misdirected(scope) or self._unknown(scope)
        if refusal is None:
            await self._app(scope, *self._while_known(scope, receive, _with_headers(send)))
        elif refusal.status == HTTPStatus.UNAUTHORIZED and _wants_page(scope):
            await RedirectResponse(LOGIN_PATH, HTTPStatus.SEE_OTHER)(
                scope, receive, _with_headers(send)
            )
        else:
            await deny(refusal, scope, receive, _with_headers(send))

    def _misdirected(self, scope: Scope) -> ServiceError | None:
        """Refuse what comes by a foreign name or from a foreign page, whoever asks."""
        headers = Headers(scope=scope)
        if not self._door.beyond and not is_loopback(_host_name(headers.get("host", ""))):
            return ServiceError(
                "host_refused",
                "This server answers only to the name of this machine.",
                HTTPStatus.MISDIRECTED_REQUEST,
            )
        if _changes(scope) and not _same_origin(headers):
            return ServiceError(
                "origin_refused", "Only this server's own page may ask this.", HTTPStatus.FORBIDDEN
            )
        return None

    def _unknown(self, scope: Scope) -> ServiceError | None:
        """Refuse who is not known, may not ask this, or did not mean to."""
        path = scope["path"]
        method = "GET" if scope["type"] == "websocket" else scope["method"]
        if path in OPEN_PATHS or (method, path) in OPEN_REQUESTS:
            return None
        identity = self._door.identify(scope)
        if identity is None:
            return ServiceError(
                "unauthorized", "Log in, or send a valid token.", HTTPStatus.UNAUTHORIZED
            )
        if not identity.role.covers(needed_role(method, path)):
            return ServiceError(
                "forbidden",
                f"This needs the role {needed_role(method, path)}; you are {identity.role}.",
                HTTPStatus.FORBIDDEN,
            )
        if identity.session is not None and _changes(scope):
            headers = Headers(scope=scope)
            if "origin" not in headers and headers.get("sec-fetch-site") != "same-origin":
                return ServiceError(
                    "origin_refused", "A browser says where it comes from.", HTTPStatus.FORBIDDEN
                )
            given = headers.get("x-csrf-token", "").encode()
            by_page = scope["type"] == "http" and path.startswith("/api/")
            if by_page and not hmac.compare_digest(given, identity.csrf.encode()):
                return ServiceError(
                    "csrf_refused",
                    "A change in a browser's session needs its X-CSRF-Token.",
                    HTTPStatus.FORBIDDEN,
                )
        scope["identity"] = identity
        return None

    def _while_known(self, scope: Scope, receive: Receive, send: Send) -> tuple[Receive, Send]:
        """Return how to hear and speak: on a socket, for as long as its session lasts."""
        identity = scope.get("identity")
        if scope["type"] != "websocket" or not isinstance(identity, Identity):
            return receive, send
        socket = _Socket(receive, send, lambda: self._door.still(identity))
        return socket.receive, socket.send


class _Socket:
    """A socket that is closed by the first message, either way, after its session has ended."""

    def __init__(self, receive: Receive, send: Send, lasts: Callable[[], bool]) -> None:
        self._receive = receive
        self._send = send
        self._lasts = lasts
        self._closed = False

    async def receive(self) -> Message:
        """Return what the client says, or that it is gone."""
        message = await self._receive()
        if message["type"] == "websocket.receive" and not self._lasts():
            return {"type": "websocket.disconnect", "code": CLOSE_LOGGED_OUT}
        return message

    async def send(self, message: Message) -> None:
        """Tell the client, or close its socket; nothing more is said on one that is closed."""
        if self._closed:
            return
        if message["type"] == "websocket.send" and not self._lasts():
            self._closed = True
            message = {"type": "websocket.close", "code": CLOSE_LOGGED_OUT, "reason": "logged out"}
        await self._send(message)


class BodyLimit:
    """Reads each request body before the application does, and refuses a longer one.

    A declared length is refused unread; one that is not declared is refused at the byte that
    is too much. So no handler ever holds more than the limit.
    """

    def __init__(self, app: ASGIApp, *, limit: int = MAX_BODY_BYTES) -> None:
        self._app = app
        self._limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on with its body read, or refuse it."""
        if scope["type"] != "http" or scope["method"] in SAFE_METHODS:
            await self._app(scope, receive, send)
            return
        declared = Headers(scope=scope).get("content-length", "")
        try:
            if declared.isdecimal() and int(declared) > self._limit:
                raise self._too_large()
            body = await self._read(receive)
        except ServiceError as error:
            await deny(error, scope, receive, send)
        except ClientDisconnect:
            return  # half a request is none, and nobody is there to be answered
        else:
            await self._app(scope, _replay(body, receive), send)

    async def _read(self, receive: Receive) -> bytes:
        """Return the whole body. Raises ServiceError 413, ClientDisconnect where it breaks off."""
        parts: list[bytes] = []
        length = 0
        while True:
            message = await receive()
            if message["type"] != "http.request":
                raise ClientDisconnect
            part = message.get("body", b"")
            length += len(part)
            if length > self._limit:
                raise self._too_large()
            parts.append(part)
            if not message.get("more_body", False):
                return b"".join(parts)

    def _too_large(self) -> ServiceError:
        return ServiceError(
            "body_too_large",
            f"A request body may have at most {self._limit} bytes.",
            HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
            {"limit_bytes": self._limit},
        )


def _replay(body: bytes, receive: Receive) -> Receive:
    """Return a receive that gives the body once, then what the connection says."""
    given = False

    async def replayed() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return replayed


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] in {"http.response.start", "websocket.http.response.start"}:
            headers = MutableHeaders(scope=message)
            for name, value in SECURITY_HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return sending


async def deny(error: ServiceError, scope: Scope, receive: Receive, send: Send) -> None:
    """Refuse a request or a socket in the one shape."""
    response: Response = error_response(error)
    if scope["type"] == "websocket":
        await WebSocket(scope, receive, send).send_denial_response(response)
    else:
        await response(scope, receive, send)


def _host_name(host: str) -> str:
    """Return the name in a Host header, without its port; "" for what is none."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _same_origin(headers: Headers) -> bool:
    """Tell whether a request comes from our own page, or from no page at all."""
    origin = headers.get("origin")
    if origin is None:
        return headers.get("sec-fetch-site", "none") in {"none", "same-origin"}
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in {"http", "https"} and parts.netloc == headers.get("host", "")


def _changes(scope: Scope) -> bool:
    return scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS


def _wants_page(scope: Scope) -> bool:
    """Tell whether a person's browser asks for a page, and would be helped by the login."""
    if scope["type"] != "http" or scope["path"].startswith("/api/"):
        return False
    return "text/html" in Headers(scope=scope).get("accept", "")
