"""Whoever may not is refused, and nothing of it reaches the mission: tables of attempts."""

from typing import Any

import pytest

from server.api.security import MAX_BODY_BYTES
from tests.server.api.fortress import (
    ADMIN,
    API,
    LOOKING,
    MANAGING,
    OPERATOR,
    OURS,
    STEERING,
    VIEWER,
    bearer,
    fort,
    refused,
)

# ------------------------------------------------------------------ unknown: 401

UNKNOWN: list[tuple[str, dict[str, str]]] = [
    ("nothing", {}),
    ("wrong token", bearer("operator-token-9876543210")),
    ("token cut short", bearer(OPERATOR[:-1])),
    ("token too long", bearer(OPERATOR + "0")),
    ("empty token", {"authorization": "Bearer "}),
    ("another scheme", {"authorization": f"Basic {OPERATOR}"}),
    ("no scheme", {"authorization": OPERATOR}),
    ("token as cookie", {"cookie": f"falconer_session_8000={OPERATOR}"}),
    ("garbage as cookie", {"cookie": "falconer_session_8000=%%;;==\x7f"}),
    ("an endless cookie", {"cookie": "falconer_session_8000=" + "x" * 60_000}),
    ("token in another header", {"x-token": OPERATOR, "proxy-authorization": OPERATOR}),
]


@pytest.mark.asyncio
@pytest.mark.parametrize(("what", "headers"), UNKNOWN, ids=[what for what, _ in UNKNOWN])
async def test_who_is_unknown_does_nothing(what: str, headers: dict[str, str]) -> None:
    async with fort() as fortress:
        for method, path, body in STEERING + MANAGING:
            await refused(
                fortress, method, API + path, 401, "unauthorized", json=body, headers=headers
            )


@pytest.mark.asyncio
@pytest.mark.parametrize("path", LOOKING)
async def test_who_is_unknown_sees_nothing(path: str) -> None:
    async with fort() as fortress:
        await refused(fortress, "GET", API + path, 401, "unauthorized")
        await refused(fortress, "GET", f"{API}{path}?token={ADMIN}", 401, "unauthorized")


@pytest.mark.asyncio
async def test_a_valid_cookie_does_not_help_a_wrong_token() -> None:
    async with fort() as fortress:
        await fortress.log_in(OPERATOR)
        await refused(
            fortress, "GET", f"{API}/missions", 401, "unauthorized", headers=bearer("wrong")
        )


# ------------------------------------------------------------------ wrong role: 403


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("token", "method", "path", "body"),
    [(VIEWER, *attempt) for attempt in STEERING + MANAGING]
    + [(OPERATOR, *attempt) for attempt in MANAGING]
    + [
        (VIEWER, "PUT", "/missions/m1/weights", {}),
        (VIEWER, "PATCH", "/missions/m1", {}),
        (VIEWER, "POST", "/missions/m1/no-such-thing", {}),
        (OPERATOR, "POST", "/missions/m1/fork", {"at_s": 1.0}),
        (OPERATOR, "POST", "/missions/", {"scenario": "scripted"}),
        (OPERATOR, "POST", "/experiments", {}),
        (OPERATOR, "POST", "/scenarios", {}),
    ],
)
async def test_a_role_does_not_do_what_is_another_s(
    token: str, method: str, path: str, body: Any
) -> None:
    async with fort() as fortress:
        await refused(
            fortress, method, API + path, 403, "forbidden", json=body, headers=bearer(token)
        )
        csrf = await fortress.log_in(token)
        headers = {**OURS, "x-csrf-token": csrf}
        await refused(fortress, method, API + path, 403, "forbidden", json=body, headers=headers)


# ------------------------------------------------------------------ other origins: 403

FOREIGN: list[dict[str, str]] = [
    {"origin": "https://evil.example"},
    {"origin": "http://evil.example:8000"},
    {"origin": "http://127.0.0.1:9999"},
    {"origin": "http://127.0.0.1"},
    {"origin": "https://127.0.0.1:8000.evil.example"},
    {"origin": "http://localhost:8000"},
    {"origin": "null"},
    {"origin": ""},
    {"origin": "file://"},
    {"sec-fetch-site": "cross-site"},
    {"sec-fetch-site": "same-site"},
]


@pytest.mark.asyncio
@pytest.mark.parametrize("headers", FOREIGN, ids=str)
async def test_a_foreign_page_does_nothing_whatever_it_shows(headers: dict[str, str]) -> None:
    async with fort() as fortress:
        for method, path, body in STEERING + MANAGING:
            shown = {**bearer(ADMIN), **headers}
            await refused(
                fortress, method, API + path, 403, "origin_refused", json=body, headers=shown
            )
        csrf = await fortress.log_in(ADMIN)
        for method, path, body in STEERING:
            shown = {"x-csrf-token": csrf, **headers}
            await refused(
                fortress, method, API + path, 403, "origin_refused", json=body, headers=shown
            )
        form = {"origin": headers.get("origin", ""), **headers}
        await refused(fortress, "POST", f"{API}/session", 403, json={"token": ADMIN}, headers=form)


# ------------------------------------------------------------------ oversized and malformed

LONG = b"x" * (MAX_BODY_BYTES + 1)


@pytest.mark.asyncio
@pytest.mark.parametrize(("method", "path"), [(m, p) for m, p, _ in STEERING + MANAGING])
async def test_a_body_too_large_is_refused(method: str, path: str) -> None:
    async with fort() as fortress:
        await refused(
            fortress, method, API + path, 413, "body_too_large",
            content=LONG, headers=bearer(ADMIN),
        )  # fmt: skip


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/missions/m1/comments", {"text": "x" * 2001}),
        ("/missions/m1/comments", {"text": ""}),
        ("/missions/m1/comments", {"text": "a", "author": "admin"}),
        ("/missions/m1/comments", {"text": ["a"]}),
        ("/missions/m1/comments", None),
        ("/session", {"token": ""}),
        ("/session", {"token": "x" * 501}),
        ("/session", {"token": OPERATOR, "name": "a\nb"}),
        ("/session", {"token": OPERATOR, "role": "admin"}),
        ("/missions", {"scenario": "../../etc/passwd"}),
        ("/missions", {"scenario": "scripted", "llm": "http://169.254.0.1/"}),
        ("/missions", {"scenario": "scripted", "seed": -1}),
        ("/missions", {"scenario": "scripted", "role": "admin"}),
    ],
)
async def test_a_body_that_does_not_fit_is_refused(path: str, body: Any) -> None:
    async with fort() as fortress:
        await refused(
            fortress, "POST", API + path, 422, "invalid_request", json=body, headers=bearer(ADMIN)
        )
