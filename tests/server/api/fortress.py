"""A server with tokens that flies a mission, and attempts at it that must be refused."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import httpx

from server.api.models import MissionRequest
from server.journal.entry import EntryKind
from tests.server.api.serving import Stage, client_of
from tests.server.waiting import eventually

API = "/api/v1"
HOST = "http://127.0.0.1:8000"
OURS = {"origin": HOST}
ADMIN = "admin-token-0123456789"
OPERATOR = "operator-token-0123456789"
VIEWER = "viewer-token-0123456789"
TOKENS = {"admin_token": ADMIN, "operator_token": OPERATOR, "viewer_token": VIEWER}
SECRET = {"session_secret": "a-secret-that-signs-cookies"}

STEERING: list[tuple[str, str, Any]] = [
    ("POST", "/missions/m1/start", None),
    ("POST", "/missions/m1/hold", None),
    ("POST", "/missions/m1/pause", None),
    ("POST", "/missions/m1/resume", None),
    ("POST", "/missions/m1/stop", None),
    ("POST", "/missions/m1/comments", {"text": "Focus."}),
]
MANAGING: list[tuple[str, str, Any]] = [
    ("POST", "/missions", {"scenario": "scripted"}),
    ("DELETE", "/missions/m1", None),
]
LOOKING = [
    "/scenarios",
    "/llm-profiles",
    "/missions",
    "/missions/m1",
    "/missions/m1/snapshot",
    "/missions/m1/events",
    "/missions/m1/history",
    "/missions/m1/result",
    "/missions/m1/comments",
    "/session",
    "/openapi.json",
    "/no-such-route",
]


def bearer(token: str) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"}


@dataclass
class Fort:
    """A server with tokens that flies a mission, and a client that has shown nothing yet."""

    stage: Stage
    client: httpx.AsyncClient

    async def log_in(self, token: str, name: str = "") -> str:
        """Log the client in as a browser; return the session's CSRF token."""
        body = {"token": token, "name": name}
        answer = await self.client.post(f"{API}/session", json=body, headers=OURS)
        assert answer.status_code == 201, answer.text
        csrf: str = answer.json()["csrf"]
        return csrf

    async def journal(self, kind: EntryKind) -> list[dict[str, Any]]:
        entries = await self.stage.service.chronicle.journal.read("", (kind,))
        return [{"author": entry.author, **entry.data} for entry in entries]

    def touched(self) -> list[tuple[str, dict[str, Any]]]:
        """Return everything that the mission was asked."""
        return list(self.stage.planners[0].requests)


@asynccontextmanager
async def fort(**settings: Any) -> AsyncIterator[Fort]:
    stage = Stage()
    app = stage.app(**{**TOKENS, **SECRET, **settings})
    async with client_of(app, stage) as client:
        await stage.service.create(MissionRequest(scenario="scripted"), "test")
        await stage.service.start("m1", "test")
        await eventually(lambda: stage.service.snapshot("m1") is not None)
        yield Fort(stage, client)


async def refused(
    fortress: Fort, method: str, path: str, status: int, code: str | None = None, **request: Any
) -> None:
    """Attempt something; it must be refused in the one shape and change nothing."""
    before = fortress.touched(), fortress.stage.service.missions()
    answer = await fortress.client.request(method, path, **request)
    assert answer.status_code == status, answer.text
    assert set(answer.json()) == {"error"}
    assert code is None or answer.json()["error"]["code"] == code
    assert fortress.touched() == before[0]
    assert [m.id for m in fortress.stage.service.missions()] == [m.id for m in before[1]]
    assert fortress.stage.service.comments("m1") == ()
    for secret in (ADMIN, OPERATOR, VIEWER):
        assert secret not in answer.text
