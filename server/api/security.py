"""What every request passes before anything else looks at it. Pure ASGI.

Why so: the console has no login yet, so it may only be reached from this machine, and a page
elsewhere must not be able to use a browser on this machine as its arm. Two checks do that. The
Host header must name this machine: a foreign name that resolves to 127.0.0.1 (DNS rebinding) is
refused, for reads too. And whoever changes something or opens a WebSocket from a browser must
come from our own page: its Origin header must equal the address it asks. Programs that are no
browsers send no Origin and pass. Beyond loopback nothing is served without tokens, and there
the token is the proof; it travels in the Authorization header, which no foreign page can set.

As middleware around the whole application this covers REST, the stream, the console's own
socket and the scene alike.
"""

import hmac
import ipaddress
from collections.abc import Iterable
from http import HTTPStatus
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from server.api.errors import ServiceError, error_response

MAX_BODY_BYTES = 64 * 1024

SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
OPEN_PATHS: Final = frozenset({"/healthz", "/readyz"})
"""Answer without a token: they tell nothing but that the server lives."""

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
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}


class ExposureRefused(Exception):
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
    """Checks Host, Origin and, where tokens are configured, who asks; adds headers."""

    def __init__(
        self, app: ASGIApp, *, operator_tokens: tuple[str, ...], viewer_tokens: tuple[str, ...]
    ) -> None:
        self._app = app
        self._operators = tuple(token.encode() for token in operator_tokens if token)
        self._viewers = tuple(token.encode() for token in viewer_tokens if token)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a connection on, or refuse it."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, _with_headers(send))
        else:
            await _deny(refusal, scope, receive, _with_headers(send))

    def _refusal(self, scope: Scope) -> ServiceError | None:
        headers = Headers(scope=scope)
        changes = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        guarded = bool(self._operators or self._viewers)
        if not guarded and not is_loopback(_host_name(headers.get("host", ""))):
            return ServiceError(
                "host_refused",
                "This server answers only to the name of this machine.",
                HTTPStatus.MISDIRECTED_REQUEST,
            )
        if changes and not _same_origin(headers):
            return ServiceError(
                "origin_refused", "Only this server's own page may ask this.", HTTPStatus.FORBIDDEN
            )
        if guarded and scope["path"] not in OPEN_PATHS:
            return self._token_refusal(scope, headers)
        return None

    def _token_refusal(self, scope: Scope, headers: Headers) -> ServiceError | None:
        scheme, _, token = headers.get("authorization", "").partition(" ")
        given = token.strip().encode() if scheme.lower() == "bearer" else b""
        if _any_equal(given, self._operators):
            return None
        if not _any_equal(given, self._viewers):
            return ServiceError("unauthorized", "A valid token is needed.", HTTPStatus.UNAUTHORIZED)
        if scope["type"] == "http" and scope["method"] not in SAFE_METHODS:
            return ServiceError(
                "forbidden", "A viewer's token may only look.", HTTPStatus.FORBIDDEN
            )
        return None


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
        body = None
        if not (declared.isdecimal() and int(declared) > self._limit):
            body = await self._read(receive)
        if body is None:
            await _deny(
                ServiceError(
                    "body_too_large",
                    f"A request body may have at most {self._limit} bytes.",
                    HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
                    {"limit_bytes": self._limit},
                ),
                scope,
                receive,
                send,
            )
            return
        await self._app(scope, _replay(body, receive), send)

    async def _read(self, receive: Receive) -> bytes | None:
        """Return the whole body, None when it is too long."""
        parts: list[bytes] = []
        length = 0
        while True:
            message = await receive()
            if message["type"] != "http.request":
                return b"".join(parts)
            part = message.get("body", b"")
            length += len(part)
            if length > self._limit:
                return None
            parts.append(part)
            if not message.get("more_body", False):
                return b"".join(parts)


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


async def _deny(error: ServiceError, scope: Scope, receive: Receive, send: Send) -> None:
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
    parts = urlsplit(origin)
    return parts.scheme in {"http", "https"} and parts.netloc == headers.get("host", "")


def _any_equal(given: bytes, known: tuple[bytes, ...]) -> bool:
    """Compare in constant time, with every known token whatever the first ones say."""
    return sum(hmac.compare_digest(given, token) for token in known) > 0


def author_of(connection: HTTPConnection) -> str:
    """Return who is held to have asked. Until there are accounts: the operator."""
    return "operator"
