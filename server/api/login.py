"""Logging in and out: a plain page for people, `/api/v1/session` for programs' browsers."""

import html
from collections.abc import Mapping
from http import HTTPStatus
from typing import Annotated, Final
from urllib.parse import parse_qs

from fastapi import APIRouter, Depends, Request, Response
from pydantic import Field, StringConstraints
from starlette.responses import HTMLResponse, RedirectResponse

from server.api.access import Access
from server.api.errors import ServiceError
from server.api.identity import Identity, Role, identity_of
from server.api.missions import service_of
from server.api.models import Answer, Body, ErrorAnswer
from server.api.sessions import clear_cookies, set_cookies

LOGIN: Final = "/login"

PersonName = Annotated[
    str, StringConstraints(strip_whitespace=True, max_length=40, pattern=r"^[\w .'-]*$")
]


class LoginRequest(Body):
    """What a login needs."""

    token: str = Field(min_length=1, max_length=500, description="Of a viewer, operator or admin.")
    name: PersonName = Field("", description="Who you are, for the journal.", examples=["Ada"])


class SessionAnswer(Answer):
    """Who is logged in."""

    name: str = Field(description="As it stands in the journal.")
    role: Role
    csrf: str = Field(description="To be sent as X-CSRF-Token with every change, in a browser.")


_REFUSED: dict[int | str, dict[str, object]] = {
    HTTPStatus.UNAUTHORIZED: {"model": ErrorAnswer},
    HTTPStatus.TOO_MANY_REQUESTS: {"model": ErrorAnswer},
    HTTPStatus.UNPROCESSABLE_ENTITY: {"model": ErrorAnswer},
}

router = APIRouter(tags=["session"])
pages = APIRouter(include_in_schema=True, tags=["session"])


def access_of(request: Request) -> Access:
    """Return the application's door. Raises ServiceError 404 where nobody can log in."""
    door = request.app.state.door
    if not isinstance(door, Access):
        raise ServiceError("no_logins", "There are no logins here.", HTTPStatus.NOT_FOUND)
    return door


Door = Annotated[Access, Depends(access_of)]


@router.post("/session", status_code=HTTPStatus.CREATED, responses=_REFUSED)
async def log_in(
    body: LoginRequest, request: Request, response: Response, door: Door
) -> SessionAnswer:
    """Log a browser in: the answer sets its session cookie."""
    identity, value = _logged_in(request, door, body.token, body.name)
    for cookie in set_cookies(request.scope, identity, value):
        response.headers.append("set-cookie", cookie)
    return _answer(identity)


@router.get("/session", responses={HTTPStatus.UNAUTHORIZED: {"model": ErrorAnswer}})
async def get_session(request: Request) -> SessionAnswer:
    """Return who asks."""
    return _answer(identity_of(request))


@router.delete(
    "/session",
    status_code=HTTPStatus.NO_CONTENT,
    responses={HTTPStatus.UNAUTHORIZED: {"model": ErrorAnswer}},
)
async def log_out(request: Request, response: Response, door: Door) -> None:
    """End the session that asks. Its cookie is worth nothing from now on."""
    _log_out(request, door)
    for cookie in clear_cookies(request.scope):
        response.headers.append("set-cookie", cookie)


@pages.get(LOGIN, response_class=HTMLResponse)
async def login_page(request: Request, key: str = "") -> Response:
    """Show the login page; with the `key` of a one-time link, log in at once."""
    if not key:
        return HTMLResponse(_page(""))
    try:
        identity, value = access_of(request).use_link(key[:200], _address(request))
    except ServiceError as error:
        _note_refusal(request, "", "link", error)
        return HTMLResponse(_page(error.message), status_code=error.status)
    _note(request, identity.name, {"did": "login", "by": "link", "session": identity.session})
    return _welcome(request, identity, value)


@pages.post(LOGIN, response_class=HTMLResponse)
async def login_form(request: Request) -> Response:
    """Log in by the page's form, and go to the console."""
    fields = parse_qs((await request.body()).decode("utf-8", "replace"))
    token, name = (fields.get(field, [""])[0].strip() for field in ("token", "name"))
    plain = "".join(c for c in name if c.isalnum() or c in " .'-")[:40].strip()
    try:
        identity, value = _logged_in(request, access_of(request), token, plain)
    except ServiceError as error:
        return HTMLResponse(_page(error.message), status_code=error.status)
    return _welcome(request, identity, value)


def _logged_in(request: Request, door: Access, token: str, name: str) -> tuple[Identity, str]:
    try:
        identity, value = door.log_in(token, name, _address(request))
    except ServiceError as error:
        _note_refusal(request, name, "token", error)
        raise
    said = {"did": "login", "by": "token", "role": identity.role, "session": identity.session}
    _note(request, identity.name, said)
    return identity, value


def _log_out(request: Request, door: Access) -> None:
    identity = identity_of(request)
    if identity.session is not None:
        door.sessions.revoke(identity.session)
        _note(request, identity.name, {"did": "logout", "session": identity.session})


def _note_refusal(request: Request, author: str, by: str, error: ServiceError) -> None:
    """Write a failed try into the journal; one that a closed door turned away is none.

    So strangers make it no longer than by what the door lets them try.
    """
    if error.status == HTTPStatus.UNAUTHORIZED:
        _note(request, author, {"did": "refused", "by": by, "code": error.code})


def _note(request: Request, author: str, said: Mapping[str, object]) -> None:
    """Write it into the journal; never a token."""
    body = {**said, "address": _address(request)}
    service_of(request).chronicle.session(author, body)


def _address(request: Request) -> str:
    return "" if request.client is None else request.client.host


def _answer(identity: Identity) -> SessionAnswer:
    return SessionAnswer(name=identity.name, role=identity.role, csrf=identity.csrf)


def _welcome(request: Request, identity: Identity, value: str) -> Response:
    response = RedirectResponse("/", status_code=HTTPStatus.SEE_OTHER)
    for cookie in set_cookies(request.scope, identity, value):
        response.headers.append("set-cookie", cookie)
    return response


def _page(problem: str) -> str:
    shown = f'<p role="alert">{html.escape(problem)}</p>' if problem else ""
    return _PAGE.replace("{problem}", shown)


_PAGE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Falconer: log in</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif; }
body { margin: 0; min-height: 100vh; display: grid; place-items: center; }
form { display: grid; gap: .75rem; width: min(22rem, 90vw); }
h1 { font-size: 1.25rem; margin: 0; }
input, button { font: inherit; padding: .5rem .75rem; border-radius: .25rem;
  border: 1px solid GrayText; }
label { display: grid; gap: .25rem; }
p { margin: 0; border-left: 3px solid; padding-left: .75rem; }
</style></head><body>
<form method="post" action="/login" autocomplete="off">
<h1>Falconer</h1>{problem}
<label>Token <input name="token" type="password" required autofocus></label>
<label>Your name, for the journal <input name="name" maxlength="40"></label>
<button>Log in</button>
<small>Without tokens: open the link that the server printed when it started, or restart it for
a new one.</small>
</form></body></html>"""
