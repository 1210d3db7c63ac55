import json
from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest
from starlette.types import Message, Receive, Scope, Send
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Origin

from server.api.security import (
    MAX_BODY_BYTES,
    BodyLimit,
    ExposureRefused,
    check_exposure,
    is_loopback,
)
from tests.patience import PATIENCE_S
from tests.server.api.serving import Stage, client_of, served

API = "/api/v1"
ADMIN = "admin-token-0123456789"
OPERATOR = "operator-token-0123456789"
VIEWER = "viewer-token-0123456789"


async def asked(
    method: str = "GET",
    path: str = f"{API}/missions",
    *,
    settings: dict[str, Any] | None = None,
    **request: Any,
) -> httpx.Response:
    stage = Stage()
    async with client_of(stage.app(**(settings or {})), stage) as client:
        return await client.request(method, path, **request)


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "localhost", "LOCALHOST", "::1", "[::1]", "127.8.8.8"]
)
def test_loopback_is_known(host: str) -> None:
    assert is_loopback(host)
    check_exposure(host, ())


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.7", "falconer.example", ""])
def test_listening_beyond_this_machine_needs_a_token(host: str) -> None:
    with pytest.raises(ExposureRefused, match="FALCONER_OPERATOR_TOKEN"):
        check_exposure(host, ())
    check_exposure(host, (OPERATOR,))


def test_an_application_for_the_world_is_not_made_without_tokens() -> None:
    with pytest.raises(ExposureRefused):
        Stage().app(host="0.0.0.0")


@pytest.mark.asyncio
@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8000", "127.0.0.1.evil.example", "10.0.0.1", "", "[::1"]
)
async def test_a_foreign_host_name_is_refused_even_for_reading(host: str) -> None:
    answer = await asked(headers={"host": host})
    assert answer.status_code == 421
    assert answer.json()["error"]["code"] == "host_refused"


@pytest.mark.asyncio
@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:8000", "[::1]:8000", "127.0.0.1"])
async def test_this_machine_is_answered(host: str) -> None:
    assert (await asked(headers={"host": host})).status_code == 200


@pytest.mark.asyncio
@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "https://evil.example"},
        {"origin": "http://127.0.0.1:9999"},
        {"origin": "http://localhost:8000"},  # another name of this machine is another origin
        {"origin": "null"},
        {"origin": "file://"},
        {"origin": "http://["},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
    ],
)
async def test_a_foreign_page_cannot_change_anything(headers: dict[str, str]) -> None:
    body = {"scenario": "scripted"}
    answer = await asked("POST", json=body, headers=headers)
    assert answer.status_code == 403
    assert answer.json()["error"]["code"] == "origin_refused"


@pytest.mark.asyncio
@pytest.mark.parametrize(
    "headers", [{}, {"origin": "http://127.0.0.1:8000"}, {"sec-fetch-site": "same-origin"}]
)
async def test_our_own_page_and_programs_can(headers: dict[str, str]) -> None:
    answer = await asked("POST", json={"scenario": "scripted"}, headers=headers)
    assert answer.status_code == 201


@pytest.mark.asyncio
async def test_a_long_body_is_refused_unread() -> None:
    body = b'{"text": "' + b"x" * (10 * 1024 * 1024) + b'"}'
    answer = await asked("POST", f"{API}/missions/m1/comments", content=body)
    assert answer.status_code == 413
    assert answer.json()["error"]["details"] == {"limit_bytes": MAX_BODY_BYTES}


@pytest.mark.asyncio
async def test_a_long_body_of_undeclared_length_is_refused_where_it_is_too_long() -> None:
    sent = 0

    async def endless() -> AsyncIterator[bytes]:
        nonlocal sent
        while sent < 10 * 1024 * 1024:
            sent += 1024
            yield b"x" * 1024

    answer = await asked("POST", f"{API}/missions/m1/comments", content=endless())
    assert answer.status_code == 413
    assert sent < 2 * MAX_BODY_BYTES


@pytest.mark.asyncio
@pytest.mark.parametrize(("extra", "status"), [(0, 422), (1, 413)])
async def test_the_limit_is_exact(extra: int, status: int) -> None:
    frame = len(json.dumps({"text": ""}))
    body = json.dumps({"text": "x" * (MAX_BODY_BYTES - frame + extra)})
    assert (await asked("POST", f"{API}/missions/m1/comments", content=body)).status_code == status


@pytest.mark.asyncio
async def test_half_a_body_is_no_request() -> None:
    """A change whose sender is gone in the middle of it is not made."""
    asked: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        asked.append(scope["path"])

    said: list[Message] = [
        {"type": "http.request", "body": b'{"text": "Hold', "more_body": True},
        {"type": "http.disconnect"},
    ]

    async def receive() -> Message:
        return said.pop(0)

    async def send(message: Message) -> None:
        raise AssertionError(message)

    scope = {"type": "http", "method": "POST", "path": "/api/v1/missions", "headers": []}
    await BodyLimit(app)(scope, receive, send)
    assert asked == []
    assert said == []


@pytest.mark.asyncio
async def test_ten_megabytes_over_a_real_connection_get_their_answer() -> None:
    stage = Stage()
    async with served(stage.app()) as address, httpx.AsyncClient(timeout=PATIENCE_S) as client:
        body = b"x" * (10 * 1024 * 1024)
        url = f"http://{address}{API}/missions/m1/comments"
        answer = await client.post(url, content=body)
        assert answer.status_code == 413
        assert answer.json()["error"]["code"] == "body_too_large"
        assert (await client.get(f"http://{address}/healthz")).status_code == 200


@pytest.mark.asyncio
async def test_answers_carry_security_headers() -> None:
    answer = await asked()
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert "connect-src 'self'" in answer.headers["content-security-policy"]
    assert answer.headers["x-frame-options"] == "SAMEORIGIN"


TOKENS = {
    "host": "0.0.0.0",
    "admin_token": ADMIN,
    "operator_token": OPERATOR,
    "viewer_token": VIEWER,
}


def bearer(token: str) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"}


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("method", "headers", "status"),
    [
        ("GET", {}, 401),
        ("GET", bearer("wrong"), 401),
        ("GET", {"authorization": f"Basic {OPERATOR}"}, 401),
        ("GET", bearer(OPERATOR + "x"), 401),
        ("GET", bearer(VIEWER), 200),
        ("GET", bearer(OPERATOR), 200),
        ("POST", bearer(VIEWER), 403),
        ("POST", bearer(OPERATOR), 403),
        ("POST", bearer(ADMIN), 201),
        ("POST", {**bearer(ADMIN), "origin": "https://evil.example"}, 403),
    ],
)
async def test_with_tokens_everything_needs_one(
    method: str, headers: dict[str, str], status: int
) -> None:
    body = {"scenario": "scripted"} if method == "POST" else None
    answer = await asked(method, settings=TOKENS, headers=headers, json=body)
    assert answer.status_code == status


@pytest.mark.asyncio
async def test_health_needs_no_token() -> None:
    assert (await asked(path="/healthz", settings=TOKENS)).status_code == 200


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("headers", "status"),
    [({"origin": "https://evil.example"}, 403), ({"host": "evil.example"}, 421)],
)
async def test_a_foreign_page_cannot_open_the_stream(headers: dict[str, str], status: int) -> None:
    stage = Stage()
    async with served(stage.app()) as address:
        name, port = address.split(":")
        url = f"ws://{headers.get('host', address)}{API}/missions/m1/stream"
        origin = Origin(headers["origin"]) if "origin" in headers else None
        opened = connect(url, origin=origin, host=name, port=int(port), open_timeout=PATIENCE_S)
        with pytest.raises(InvalidStatus) as refused:
            await opened
    assert refused.value.response.status_code == status
