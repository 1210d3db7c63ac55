"""Sessions of browsers: proof, replay, forgery, logging in and out; and the sockets they open."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import httpx
import pytest
from structlog.testing import capture_logs
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Origin

from server.api.access import MAX_FAILURES, WINDOW_S, Access
from server.api.app import create_app
from server.api.identity import Role
from server.api.models import MissionRequest
from server.api.security import CLOSE_LOGGED_OUT
from server.api.sessions import LIFETIME_S, Sessions
from server.journal.entry import Entry, EntryKind
from server.settings import Settings
from tests.patience import PATIENCE_S
from tests.server.api.fortress import (
    ADMIN,
    API,
    OPERATOR,
    OURS,
    SECRET,
    STEERING,
    TOKENS,
    VIEWER,
    Fort,
    bearer,
    fort,
    refused,
)
from tests.server.api.serving import Stage, client_of, served
from tests.server.waiting import eventually

# ------------------------------------------------------------------ CSRF: 403


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("what", "headers", "code"),
    [
        ("no proof", OURS, "csrf_refused"),
        ("empty proof", {**OURS, "x-csrf-token": ""}, "csrf_refused"),
        ("wrong proof", {**OURS, "x-csrf-token": "0" * 64}, "csrf_refused"),
        ("proof in a cookie only", {**OURS, "cookie": "falconer_csrf_8000=x"}, "unauthorized"),
        ("the session's cookie as proof", {**OURS, "x-csrf-token": "cookie"}, "csrf_refused"),
        ("another session's proof", {**OURS, "x-csrf-token": "other"}, "csrf_refused"),
        ("no origin", {"x-csrf-token": "own"}, "origin_refused"),
    ],
)
async def test_a_session_needs_its_own_proof(what: str, headers: dict[str, str], code: str) -> None:
    async with fort() as fortress:
        other = await fortress.log_in(OPERATOR)
        fortress.client.cookies.clear()
        own = await fortress.log_in(OPERATOR)
        cookie = fortress.client.cookies["falconer_session_8000"]
        real = {"other": other, "own": own, "cookie": cookie}
        sent = {name: real.get(value, value) for name, value in headers.items()}
        if "cookie" in sent:
            fortress.client.cookies.clear()
        status = 401 if code == "unauthorized" else 403
        for method, path, body in STEERING:
            await refused(fortress, method, API + path, status, code, json=body, headers=sent)


# ------------------------------------------------------------------ replayed: 401


@pytest.mark.asyncio
async def test_a_cookie_is_worth_nothing_after_logging_out() -> None:
    async with fort() as fortress:
        csrf = await fortress.log_in(OPERATOR)
        kept = dict(fortress.client.cookies)
        proof = {**OURS, "x-csrf-token": csrf}
        assert (await fortress.client.delete(f"{API}/session", headers=proof)).status_code == 204
        fortress.client.cookies.clear()
        fortress.client.cookies.update(kept)
        for method, path, body in STEERING:
            await refused(fortress, method, API + path, 401, json=body, headers=proof)
        await refused(fortress, "GET", f"{API}/missions", 401)


def forged(**changes: Any) -> str:
    """Return a cookie as an attacker, or an earlier server, might have made it."""
    tokens = changes.get("tokens", Settings.model_validate(TOKENS).tokens())
    sessions = Sessions(changes.get("secret", SECRET["session_secret"]), tokens)
    return sessions.open("mallory", Role.ADMIN)[1]


@pytest.mark.asyncio
@pytest.mark.parametrize(
    "cookie",
    [
        pytest.param(forged(secret="another secret altogether"), id="another secret"),
        pytest.param(forged(tokens=(ADMIN, OPERATOR, "old-viewer-token")), id="older tokens"),
        pytest.param("e30" + forged()[3:], id="payload changed"),
        pytest.param(forged()[:-2], id="signature cut"),
        pytest.param("." + forged().rsplit(".", 1)[1], id="signature only"),
        pytest.param("", id="empty"),
    ],
)
async def test_a_forged_cookie_opens_nothing(cookie: str) -> None:
    async with fort() as fortress:
        headers = {"cookie": f"falconer_session_8000={cookie}"}
        await refused(fortress, "GET", f"{API}/missions", 401, headers=headers)
        await refused(fortress, "POST", f"{API}/missions/m1/stop", 401, headers=headers | OURS)


@pytest.mark.asyncio
async def test_what_other_servers_of_this_host_have_set_keeps_nobody_out() -> None:
    """Browsers send a host's cookies to each of its ports, whatever stands in them."""
    async with fort() as fortress:
        await fortress.log_in(VIEWER)
        own = fortress.client.cookies["falconer_session_8000"]
        fortress.client.cookies.clear()
        for odd in ('theirs={"a": [1, 2]}', "theirs=ü", 'theirs="', "=;;theirs"):
            sent = [(b"cookie", f"{odd}; falconer_session_8000={own}; last={odd}".encode())]
            answer = await fortress.client.get(f"{API}/session", headers=sent)
            assert answer.status_code == 200, odd


@pytest.mark.asyncio
async def test_a_cookie_expires(monkeypatch: pytest.MonkeyPatch) -> None:
    async with fort() as fortress:
        await fortress.log_in(OPERATOR)
        assert (await fortress.client.get(f"{API}/missions")).status_code == 200
        later = time.time() + LIFETIME_S + 5
        monkeypatch.setattr("itsdangerous.timed.time.time", lambda: later)
        await refused(fortress, "GET", f"{API}/missions", 401)


@pytest.mark.asyncio
@pytest.mark.parametrize(("role", "status"), [(Role.OPERATOR, 403), (Role.ADMIN, 201)])
async def test_a_link_works_once_and_gives_its_role(role: Role, status: int) -> None:
    stage = Stage()
    door = Access(Settings())
    app = create_app(Settings(), stage.service, door=door)
    path = door.link(role)
    async with client_of(app, stage) as client:
        assert (await client.get(f"{API}/missions")).status_code == 401
        opened = await client.get(path)
        assert (opened.status_code, opened.headers["location"]) == (303, "/")
        cookie = opened.headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        csrf = client.cookies["falconer_csrf_8000"]
        proof = {**OURS, "x-csrf-token": csrf}
        made = await client.post(f"{API}/missions", json={"scenario": "scripted"}, headers=proof)
        assert made.status_code == status
        assert (await client.get(f"{API}/session")).json()["role"] == role
        client.cookies.clear()
        again = await client.get(path)
        assert again.status_code == 401
        assert "set-cookie" not in again.headers
        assert "Start Falconer again for new links" in again.text
        guesses = ("", "x", path[11:-1], path[11:] + "x", "%00", "%ed%a0%80", "é" * 100)
        for guess in guesses:
            assert "set-cookie" not in (await client.get(f"/login?key={guess}")).headers


@pytest.mark.asyncio
async def test_failed_logins_close_the_door_for_a_while() -> None:
    async with fort() as fortress:
        url = f"{API}/session"
        for _ in range(MAX_FAILURES):
            await refused(fortress, "POST", url, 401, json={"token": "guess"}, headers=OURS)
        await refused(fortress, "POST", url, 429, json={"token": "guess"}, headers=OURS)
        await refused(fortress, "POST", url, 429, json={"token": OPERATOR}, headers=OURS)
        form = await fortress.client.post("/login", data={"token": OPERATOR}, headers=OURS)
        assert form.status_code == 429
        # Whoever is in already is not kept from holding.
        held = await fortress.client.post(f"{API}/missions/m1/hold", headers=bearer(OPERATOR))
        assert held.json()["state"] == "held"
        failed: list[dict[str, Any]] = []
        async with asyncio.timeout(PATIENCE_S):  # who logs in does not wait for the journal
            while len(failed) < MAX_FAILURES:
                failed = await fortress.journal(EntryKind.SESSION)
                await asyncio.sleep(0.01)
        assert [said["did"] for said in failed][:MAX_FAILURES] == ["refused"] * MAX_FAILURES
        # Strangers at a closed door do not make the journal longer.
        await fortress.stage.service.chronicle.journal.commit(Entry(EntryKind.SERVER))
        assert len(await fortress.journal(EntryKind.SESSION)) == MAX_FAILURES
        assert OPERATOR not in str(failed)


def test_the_door_opens_again_after_the_window() -> None:
    clock = [0.0]
    door = Access(Settings.model_validate(TOKENS), now=lambda: clock[0])
    for _ in range(MAX_FAILURES):
        with pytest.raises(Exception, match="not known"):
            door.log_in("guess", "", "10.0.0.1")
    with pytest.raises(Exception, match="Too many"):
        door.log_in(OPERATOR, "", "10.0.0.1")
    assert door.log_in(OPERATOR, "", "10.0.0.2")[0].role is Role.OPERATOR
    clock[0] = WINDOW_S + 1.0
    assert door.log_in(OPERATOR, "Ada", "10.0.0.1")[0].name == "Ada (operator)"


# ------------------------------------------------------------------ sockets


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("what", "headers", "status"),
    [
        ("nothing", {}, 401),
        ("wrong token", bearer("wrong"), 401),
        ("token, foreign page", {**bearer(OPERATOR), "origin": "https://evil.example"}, 403),
        ("cookie, foreign page", {"cookie": "own", "origin": "https://evil.example"}, 403),
        ("cookie, no page", {"cookie": "own"}, 403),
        ("forged cookie", {"cookie": "forged", "origin": "own"}, 401),
    ],
)
async def test_a_socket_is_not_opened(what: str, headers: dict[str, str], status: int) -> None:
    stage = Stage()
    async with served(stage.app(**TOKENS, **SECRET)) as address:
        port = address.split(":")[1]
        tokens = Settings.model_validate(TOKENS).tokens()
        own = Sessions(SECRET["session_secret"], tokens).open("operator", Role.OPERATOR)[1]
        sent = dict(headers)
        if "cookie" in sent:
            value = own if sent["cookie"] == "own" else own[:-3]
            sent["cookie"] = f"falconer_session_{port}={value}"
        origin = sent.pop("origin", None)
        chosen = (
            None if origin is None else Origin(f"http://{address}" if origin == "own" else origin)
        )
        with pytest.raises(InvalidStatus) as told:
            await connect(
                f"ws://{address}{API}/missions/m1/stream", additional_headers=sent, origin=chosen
            )
        assert told.value.response.status_code == status


async def read_on(socket: ClientConnection) -> None:
    while True:
        await socket.recv()


@asynccontextmanager
async def streaming() -> AsyncIterator[tuple[Stage, ClientConnection, Callable[[], None]]]:
    """A stream opened by a browser's session; yields what ends that session too."""
    stage = Stage()
    app = stage.app(**TOKENS, **SECRET)
    async with served(app) as address:
        await stage.service.create(MissionRequest(scenario="scripted"), "test")
        port = address.split(":")[1]
        sessions = app.state.door.sessions
        identity, value = sessions.open("operator", Role.OPERATOR)
        headers = {"cookie": f"falconer_session_{port}={value}"}
        url, origin = f"ws://{address}{API}/missions/m1/stream", Origin(f"http://{address}")
        async with connect(url, additional_headers=headers, origin=origin) as socket:
            yield stage, socket, lambda: sessions.revoke(identity.session)


@pytest.mark.asyncio
async def test_logging_out_ends_what_a_socket_may_say() -> None:
    async with streaming() as (_, socket, log_out):
        log_out()
        await socket.send("anything")
        with pytest.raises(ConnectionClosed):
            await read_on(socket)


@pytest.mark.asyncio
async def test_logging_out_ends_what_a_socket_is_told() -> None:
    async with streaming() as (stage, socket, log_out):
        await stage.service.start("m1", "test")
        await socket.recv()
        log_out()
        with pytest.raises(ConnectionClosed) as closed:
            await read_on(socket)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == CLOSE_LOGGED_OUT
        await eventually(lambda: stage.service.readers("m1") == 0)


# ------------------------------------------------------------------ and who may, can


@pytest.mark.asyncio
async def test_each_role_does_what_is_its_own() -> None:
    async with fort() as fortress:
        client = fortress.client
        for token in (VIEWER, OPERATOR, ADMIN):
            assert (await client.get(f"{API}/missions", headers=bearer(token))).status_code == 200
        said = await client.post(
            f"{API}/missions/m1/comments", json={"text": "Focus."}, headers=bearer(OPERATOR)
        )
        assert said.json()["author"] == "operator"
        csrf = await fortress.log_in(OPERATOR, "Ada")
        proof = {**OURS, "x-csrf-token": csrf}
        held = await client.post(f"{API}/missions/m1/hold", headers=proof)
        assert held.json()["state"] == "held"
        who = (await client.get(f"{API}/session")).json()
        assert (who["name"], who["role"], who["csrf"]) == ("Ada (operator)", "operator", csrf)
        await stage_flush(fortress)
        asked = await fortress.journal(EntryKind.REQUEST)
        assert {"author": "Ada (operator)", "method": "POST", "path": f"{API}/missions/m1/hold",
                "status": 200} in asked  # fmt: skip
        assert asked[0]["body"] == {"text": "Focus."}
        assert "Ada" in str(fortress.touched())


async def stage_flush(fortress: Fort) -> None:
    """Commit something, so that what was posted before is written."""
    await fortress.stage.service.comment("m1", "flush", "test")


@pytest.mark.asyncio
async def test_sessions_outlast_a_restart_where_a_secret_is_set() -> None:
    async with fort() as first:
        await first.log_in(OPERATOR)
        kept = dict(first.client.cookies)
        first.client.cookies.clear()
        csrf = await first.log_in(OPERATOR)
        ended = dict(first.client.cookies)
        await first.client.delete(f"{API}/session", headers={**OURS, "x-csrf-token": csrf})
        folder = first.stage.folder
    again = Stage(folder=folder)
    app = again.app(**TOKENS, **SECRET)
    async with served(app) as address, httpx.AsyncClient(base_url=f"http://{address}") as client:
        port = address.split(":")[1]
        for cookies, status in ((kept, 200), (ended, 401)):
            value = cookies["falconer_session_8000"]
            headers = {"cookie": f"falconer_session_{port}={value}"}
            answer = await client.get(f"{API}/missions", headers=headers)
            assert answer.status_code == status


@pytest.mark.asyncio
async def test_a_person_s_browser_is_led_to_the_login_page() -> None:
    async with fort() as fortress:
        page = {"accept": "text/html,application/xhtml+xml"}
        led = await fortress.client.get("/", headers=page)
        assert (led.status_code, led.headers["location"]) == (303, "/login")
        shown = await fortress.client.get("/login")
        assert shown.status_code == 200
        assert 'name="token"' in shown.text
        wrong = await fortress.client.post("/login", data={"token": "<b>no"}, headers=OURS)
        assert wrong.status_code == 401
        assert "<b>" not in wrong.text
        right = await fortress.client.post(
            "/login", data={"token": OPERATOR, "name": "Ada <script>"}, headers=OURS
        )
        assert (right.status_code, right.headers["location"]) == (303, "/")
        assert (await fortress.client.get(f"{API}/session")).json()["name"] == (
            "Ada script (operator)"
        )


@pytest.mark.asyncio
async def test_no_log_line_holds_a_token() -> None:
    with capture_logs() as logged:
        async with fort() as fortress:
            await fortress.client.get(f"{API}/missions", headers=bearer(OPERATOR))
            await fortress.client.post(f"{API}/session", json={"token": "x" + ADMIN}, headers=OURS)
    assert all(secret not in str(logged) for secret in (ADMIN, OPERATOR, VIEWER))
