"""Whether the server lives, and whether it can take missions."""

from fastapi import APIRouter, Request

from server.api.missions import service_of
from server.api.models import Health, Readiness

router = APIRouter(tags=["health"])


@router.get("/healthz")
async def healthz() -> Health:
    """Answer while the event loop turns."""
    return Health(status="ok")


@router.get("/readyz")
async def readyz(request: Request) -> Readiness:
    """Answer while missions can be steered; degraded while no comments can be taken."""
    service = service_of(request)
    live = service.live_mission()
    journal = service.journal
    return Readiness(
        status="ready" if journal.available else "degraded",
        reason="" if journal.available else f"the journal is not available: {journal.reason}",
        live_mission=None if live is None else live.id,
        readers=0 if live is None else service.readers(live.id),
    )
