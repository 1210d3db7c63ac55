"""WS /api/v1/missions/{id}/stream: snapshots and events as they come."""

import asyncio
from typing import Final

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from server.api.errors import ServiceError, error_response
from server.api.service import MissionService
from server.live.fanout import TOO_SLOW
from server.live.outbox import Outbox, OutboxClosed

SEND_S: Final = 10.0
"""A client that takes no message for so long is dropped."""

CLOSE_GOING_AWAY: Final = 1001
CLOSE_TOO_SLOW: Final = 4408
CLOSE_NOT_UNDERSTOOD: Final = 4400

router = APIRouter()


@router.websocket("/missions/{mission_id}/stream")
async def stream(websocket: WebSocket, mission_id: str) -> None:
    """Send a mission's snapshots (10 Hz, the newest wins) and all its events.

    What the client sends is refused: there is nothing to say on a stream.
    """
    service: MissionService = websocket.app.state.service
    try:
        with service.frames(mission_id) as outbox:
            await websocket.accept()
            await _serve(websocket, outbox)
    except ServiceError as error:
        await websocket.send_denial_response(error_response(error))


async def _serve(websocket: WebSocket, outbox: Outbox) -> None:
    """Send until the mission is over, or the client goes, talks, or is too slow."""
    listener = asyncio.create_task(_listen(websocket))
    sender = asyncio.create_task(_send(websocket, outbox))
    try:
        await asyncio.wait({listener, sender}, return_when=asyncio.FIRST_COMPLETED)
        finished = sender if sender.done() else listener
        code, reason = finished.result()
    finally:
        for task in (listener, sender):
            task.cancel()
        await asyncio.gather(listener, sender, return_exceptions=True)
    if code is not None:
        await _close(websocket, code, reason)


async def _listen(websocket: WebSocket) -> tuple[int | None, str]:
    """Wait for the client to go; return how to close (not at all when it has gone)."""
    message = await websocket.receive()
    if message["type"] == "websocket.disconnect":
        return None, ""
    return CLOSE_NOT_UNDERSTOOD, "the stream takes no messages"


async def _send(websocket: WebSocket, outbox: Outbox) -> tuple[int | None, str]:
    """Send frames until there are no more; return how to close."""
    try:
        while True:
            frame = await outbox.get()
            async with asyncio.timeout(SEND_S):
                await websocket.send_text(frame.text)
    except OutboxClosed as closed:
        slow = closed.reason == TOO_SLOW
        return (CLOSE_TOO_SLOW if slow else CLOSE_GOING_AWAY), closed.reason
    except TimeoutError:
        return CLOSE_TOO_SLOW, f"no message was taken for {SEND_S:g} s"
    except WebSocketDisconnect:
        return None, ""


async def _close(websocket: WebSocket, code: int, reason: str) -> None:
    """Close with a reason; a client that does not even take that is left to the transport."""
    try:
        async with asyncio.timeout(SEND_S):
            await websocket.close(code, reason)
    except (TimeoutError, RuntimeError, WebSocketDisconnect):
        return
