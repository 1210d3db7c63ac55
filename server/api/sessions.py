"""Sessions of browsers: signed cookies, valid for a while, revoked by logging out.

The cookie holds who it is, signed (itsdangerous, HMAC-SHA256); the server keeps nothing but the
ids of sessions that were ended before their time. The key is made from the secret and all tokens:
changing a token ends every session.
"""

import hashlib
import hmac
import secrets
from collections.abc import Iterable
from typing import Any, Final

from itsdangerous import BadSignature, URLSafeTimedSerializer
from starlette.datastructures import Headers
from starlette.requests import cookie_parser
from starlette.types import Scope

from server.api.identity import Identity, Role

LIFETIME_S: Final = 12 * 3600
MAX_REVOKED: Final = 10_000
CSRF_COOKIE: Final = "falconer_csrf"


class Sessions:
    """Opens, reads and revokes sessions."""

    def __init__(self, secret: str | None, tokens: Iterable[str]) -> None:
        self.lasting = secret is not None
        """Whether sessions outlast a restart of the server."""

        base = (secret or secrets.token_urlsafe(32)).encode()
        key = hashlib.sha256(b"\0".join([base, *(token.encode() for token in tokens)])).digest()
        self._key = key
        self._signer = URLSafeTimedSerializer(
            key,
            salt="falconer.session",
            signer_kwargs={"key_derivation": "hmac", "digest_method": hashlib.sha256},
        )
        self._revoked: dict[str, None] = {}

    def open(self, name: str, role: Role) -> tuple[Identity, str]:
        """Return a new session and the value of its cookie."""
        session = secrets.token_urlsafe(16)
        value = self._signer.dumps({"id": session, "name": name, "role": role.value})
        return Identity(name, role, session, self._csrf(session)), str(value)

    def read(self, scope: Scope) -> Identity | None:
        """Return whose valid session a connection's cookie is, None for nobody's."""
        value = _cookie(scope, cookie_name(scope))
        if value is None:
            return None
        try:
            said: Any = self._signer.loads(value, max_age=LIFETIME_S)
            session, name, role = str(said["id"]), str(said["name"]), Role(said["role"])
        except (BadSignature, KeyError, TypeError, ValueError):
            return None
        if session in self._revoked:
            return None
        return Identity(name, role, session, self._csrf(session))

    def is_open(self, session: str) -> bool:
        """Tell whether a session that was read before has not been ended meanwhile."""
        return session not in self._revoked

    def revoke(self, session: str) -> None:
        """End a session. Its cookie is worth nothing from now on, whoever shows it."""
        self._revoked[session] = None
        while len(self._revoked) > MAX_REVOKED:
            del self._revoked[next(iter(self._revoked))]

    def _csrf(self, session: str) -> str:
        return hmac.new(self._key, b"csrf" + session.encode(), hashlib.sha256).hexdigest()


def cookie_name(scope: Scope) -> str:
    """Return the session cookie's name: browsers keep cookies per host, not per port."""
    _, _, port = Headers(scope=scope).get("host", "").rpartition(":")
    return f"falconer_session_{port}" if port.isdecimal() else "falconer_session"


def set_cookies(scope: Scope, identity: Identity, value: str) -> list[str]:
    """Return the Set-Cookie headers of a new session.

    The second cookie can be read by our page, which sends its value back as a header: a page of
    another origin can do neither.
    """
    common = f"Path=/; SameSite=Strict; Max-Age={LIFETIME_S}{_secure(scope)}"
    return [
        f"{cookie_name(scope)}={value}; HttpOnly; {common}",
        f"{csrf_cookie_name(scope)}={identity.csrf}; {common}",
    ]


def clear_cookies(scope: Scope) -> list[str]:
    """Return the Set-Cookie headers that end a session in the browser."""
    common = f"Path=/; SameSite=Strict; Max-Age=0{_secure(scope)}"
    names = (cookie_name(scope), csrf_cookie_name(scope))
    return [f"{name}=; HttpOnly; {common}" for name in names]


def csrf_cookie_name(scope: Scope) -> str:
    """Return the name of the cookie that our page reads."""
    return cookie_name(scope).replace("falconer_session", CSRF_COOKIE)


def _secure(scope: Scope) -> str:
    return "; Secure" if scope.get("scheme") in {"https", "wss"} else ""


def _cookie(scope: Scope, name: str) -> str | None:
    # A browser sends along what any other server of this host has set, on whatever port and
    # however odd. The standard library's parser gives up at the first odd one.
    return cookie_parser(Headers(scope=scope).get("cookie", "")).get(name)
