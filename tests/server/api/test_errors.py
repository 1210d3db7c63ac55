import re
from typing import Any

import httpx
import pytest
from structlog.testing import capture_logs

from server.api.errors import ServiceError
from tests.server.api.serving import Stage, client_of

API = "/api/v1"


def refused(answer: httpx.Response, status: int, code: str) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/json"
    assert set(answer.json()) == {"error"}
    error: dict[str, Any] = answer.json()["error"]
    assert set(error) == {"code", "message", "details"}
    assert error["code"] == code
    return error


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [
        ("GET", "/api/v1/nowhere", 404, "not_found"),
        ("GET", "/api/v2/missions", 404, "not_found"),
        ("POST", "/api/nowhere", 404, "not_found"),
        ("GET", "/api/v1/missions/..%2f..%2fetc", 404, "not_found"),
        ("PATCH", "/api/v1/missions", 405, "method_not_allowed"),
        ("GET", "/api/v1/missions/m1/start", 405, "method_not_allowed"),
        ("POST", "/healthz", 405, "method_not_allowed"),
        ("GET", "/api/v1/missions/m1/events?limit=0", 422, "invalid_request"),
        ("GET", "/api/v1/missions/m1/events?after=x", 422, "invalid_request"),
        ("GET", "/api/v1/missions/no%20id", 422, "invalid_request"),
    ],
)
async def test_every_refusal_has_the_one_shape(
    method: str, path: str, status: int, code: str
) -> None:
    stage = Stage()
    async with client_of(stage.app(), stage) as client:
        refused(await client.request(method, path), status, code)


@pytest.mark.asyncio
@pytest.mark.parametrize("body", [b"", b"{", b"\xff\xfe", b'{"text": "\\ud800"}', b"[" * 5000])
async def test_a_broken_body_is_told_of(body: bytes) -> None:
    stage = Stage()
    async with client_of(stage.app(), stage) as client:
        answer = await client.post(
            f"{API}/missions/m1/comments",
            content=body,
            headers={"content-type": "application/json"},
        )
    error = answer.json()["error"]
    assert 400 <= answer.status_code < 500
    assert set(error) == {"code", "message", "details"}


@pytest.mark.asyncio
@pytest.mark.parametrize("body", ["[]", "[null, null]", '"text"', "7", "null", "true"])
async def test_a_body_that_is_no_object_is_refused_by_every_route(body: str) -> None:
    app = Stage().app()
    headers = {"content-type": "application/json"}
    transport = httpx.ASGITransport(app=app)
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000") as client,
    ):
        paths = (await client.get(f"{API}/openapi.json")).json()["paths"]
        asked = 0
        for path, operations in paths.items():
            for method, operation in operations.items():
                if "requestBody" in operation:
                    url = API + re.sub(r"\{\w+\}", "m1", path)
                    answer = await client.request(method, url, content=body, headers=headers)
                    assert answer.status_code in (404, 422), (path, answer.text)
                    assert set(answer.json()) == {"error"}
                    asked += answer.status_code == 422
        assert asked > 10


@pytest.mark.asyncio
async def test_what_was_sent_is_not_repeated() -> None:
    stage = Stage()
    async with client_of(stage.app(), stage) as client:
        answer = await client.post(f"{API}/missions", json={"scenario": "x", "seed": "hunter2"})
    assert "hunter2" not in answer.text


@pytest.mark.asyncio
async def test_a_bug_is_told_without_its_insides(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage()
    monkeypatch.setattr(stage.service, "missions", lambda: 1 / 0)
    with capture_logs() as logged:
        async with client_of(stage.app(), stage) as client:
            answer = await client.get(f"{API}/missions")
            refused(answer, 500, "internal_error")
            assert "division" not in answer.text
            assert (await client.get("/healthz")).json() == {"status": "ok"}
    assert isinstance(logged[0]["exc_info"], ZeroDivisionError)


def test_an_error_reads_as_its_message() -> None:
    assert str(ServiceError("code", "Words for people.")) == "Words for people."
