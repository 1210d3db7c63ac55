"""How the application is served over HTTP: one place for uvicorn's options."""

from typing import Final

import uvicorn
from fastapi import FastAPI

from server.settings import Settings

GRACE_S: Final = 3
"""Open connections are closed after so long when the server stops: streams never end."""


def web_config(app: FastAPI, settings: Settings) -> uvicorn.Config:
    """Return the server's configuration.

    No compression of WebSocket messages: at 10 Hz and 50 clients it would cost more time than
    it saves bytes. No server header, no trust in forwarding headers, logs by our own means.
    """
    return uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        lifespan="on",
        ws="websockets-sansio",
        ws_per_message_deflate=False,
        ws_max_size=1024 * 1024,
        proxy_headers=False,
        server_header=False,
        access_log=False,
        log_config=None,
        timeout_graceful_shutdown=GRACE_S,
    )
