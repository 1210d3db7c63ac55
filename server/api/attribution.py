"""Writes into the journal who changed what by HTTP, and what they were answered."""

import json
from typing import Any, Final

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.api.identity import SAFE_METHODS, Identity
from server.api.service import MissionService

MAX_BODY_KEPT: Final = 4096
"""A longer body is told of by its length alone."""

_SECRET: Final = frozenset({"/api/v1/session", "/login"})
"""Their bodies hold tokens; logging in is written elsewhere."""


class Attribution:
    """Around the application, inside the doorkeeper: what comes here has an identity."""

    def __init__(self, app: ASGIApp, *, service: MissionService) -> None:
        self._app = app
        self._service = service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on; note it when it was to change something."""
        path = scope.get("path", "")
        if (
            scope["type"] != "http"
            or scope["method"] in SAFE_METHODS
            or path in _SECRET
            or not path.startswith("/api/")
        ):
            await self._app(scope, receive, send)
            return
        body, status = b"", 500

        async def reading() -> Message:
            nonlocal body
            message = await receive()
            if message["type"] == "http.request":
                body += message.get("body", b"")
            return message

        async def sending(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, reading, sending)
        finally:
            identity = scope.get("identity")
            author = identity.name if isinstance(identity, Identity) else ""
            said = {"method": scope["method"], "path": path[:500], "status": status}
            self._service.chronicle.request(author, {**said, **_kept(body)})


def _kept(body: bytes) -> dict[str, Any]:
    """Return what is kept of a body."""
    if not body:
        return {}
    if len(body) > MAX_BODY_KEPT:
        return {"body_bytes": len(body)}
    try:
        values: Any = json.loads(body)
        json.dumps(values, allow_nan=False)
    except (ValueError, RecursionError):
        return {"body_bytes": len(body)}
    return {"body": values}
