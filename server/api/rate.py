"""How often one client may ask: a token bucket each, in front of the API.

A program gone wild must not slow the console of the person beside it. The bucket is the client's,
not the server's: whoever asks too often waits, and nobody else does. Holding and stopping are
never counted and never refused, and neither is what the console's own page and sockets carry:
that is bounded by what one browser can do. Whoever is not known does not come so far.
"""

import re
from collections import OrderedDict
from collections.abc import Callable
from http import HTTPStatus
from math import ceil
from time import monotonic
from typing import Final

from starlette.types import ASGIApp, Receive, Scope, Send

from server.api.errors import ServiceError
from server.api.identity import Identity
from server.api.security import deny

BURST_S: Final = 5.0
"""A client that has been quiet may ask at once what it may ask in this time."""

LEAST_BURST: Final = 5.0
"""Whatever the rate: opening the console takes some requests."""

MAX_CLIENTS: Final = 1000

_NEVER: Final = re.compile(r"/api/v1/missions/[^/]+/(hold|stop)/?")
"""Stopping is never gated."""


class Buckets:
    """What each client has left. The clients seen longest ago are forgotten."""

    def __init__(self, rate_hz: float, now: Callable[[], float] = monotonic) -> None:
        self._rate_hz = rate_hz
        self._most = max(LEAST_BURST, rate_hz * BURST_S)
        self._now = now
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()
        """By client: requests left, and when they were counted."""

    def wait_s(self, client: str) -> float:
        """Count a request; return 0.0, or after how many seconds it may be asked again."""
        now_s = self._now()
        left, since_s = self._left.pop(client, (self._most, now_s))
        left = min(self._most, left + self._rate_hz * (now_s - since_s))
        granted = left >= 1.0
        self._left[client] = (left - 1.0 if granted else left, now_s)
        while len(self._left) > MAX_CLIENTS:
            self._left.popitem(last=False)
        return 0.0 if granted else (1.0 - left) / self._rate_hz


class RateLimit:
    """Around the API, inside the doorkeeper: what comes here has an identity."""

    def __init__(self, app: ASGIApp, *, buckets: Buckets) -> None:
        self._app = app
        self._buckets = buckets

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it with 429 and when to come again."""
        if not _counted(scope):
            await self._app(scope, receive, send)
            return
        wait_s = ceil(self._buckets.wait_s(_client(scope)))
        if not wait_s:
            await self._app(scope, receive, send)
            return
        refusal = ServiceError(
            "too_many_requests",
            f"Too many requests from you; ask again in {wait_s} s.",
            HTTPStatus.TOO_MANY_REQUESTS,
            {"retry_after_s": wait_s},
        )
        await deny(refusal, scope, receive, send)


def _counted(scope: Scope) -> bool:
    if scope["type"] not in {"http", "websocket"} or not scope["path"].startswith("/api/"):
        return False
    return not (scope.get("method") == "POST" and _NEVER.fullmatch(scope["path"]))


def _client(scope: Scope) -> str:
    """Return whose bucket it is: a session's, or a token's from one address."""
    identity = scope.get("identity")
    if isinstance(identity, Identity) and identity.session is not None:
        return f"session {identity.session}"
    address = scope.get("client") or ("", 0)
    name = identity.name if isinstance(identity, Identity) else ""
    return f"{name} {address[0]}"
