"""Who may come in: tokens of programs, sessions of browsers, one-time links, and failed tries."""

import hmac
import secrets
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from time import monotonic
from typing import Final, Protocol

from starlette.datastructures import Headers
from starlette.types import Scope

from server.api.errors import ServiceError
from server.api.identity import Identity, Role
from server.api.sessions import Sessions
from server.settings import Settings

MAX_FAILURES: Final = 5
WINDOW_S: Final = 60.0
"""So many failed logins in this time close the door for one address ..."""

MAX_FAILURES_OF_ALL: Final = 50
"""... and so many for all addresses together."""

MAX_ADDRESSES: Final = 1000


class Door(Protocol):
    """Says who asks."""

    def identify(self, scope: Scope) -> Identity | None:
        """Return who asks, None for nobody we know."""
        ...

    def still(self, identity: Identity) -> bool:
        """Tell whether somebody identified before may go on."""
        ...

    @property
    def beyond(self) -> bool:
        """Whether there are tokens, so that other machines may ask too."""
        ...


@dataclass(frozen=True, slots=True)
class Token:
    """A secret that stands for a role."""

    secret: bytes
    role: Role


class Access:
    """The door of a real server."""

    def __init__(self, settings: Settings, now: Callable[[], float] = monotonic) -> None:
        self._tokens = tuple(
            Token(token.get_secret_value().encode(), role)
            for role, token in (
                (Role.ADMIN, settings.admin_token),
                (Role.OPERATOR, settings.operator_token),
                (Role.VIEWER, settings.viewer_token),
            )
            if token is not None
        )
        secret = settings.session_secret
        self.sessions = Sessions(
            None if secret is None else secret.get_secret_value(), settings.tokens()
        )
        self._links: dict[str, Role] = {}
        self._failures = Failures(now)

    @property
    def beyond(self) -> bool:
        """Whether there are tokens, so that other machines may ask too."""
        return bool(self._tokens)

    def identify(self, scope: Scope) -> Identity | None:
        """Return who asks: by token, else by session. A wrong token is nobody's."""
        headers = Headers(scope=scope)
        if "authorization" in headers:
            scheme, _, given = headers["authorization"].partition(" ")
            role = self._role_of(given.strip()) if scheme.lower() == "bearer" else None
            return None if role is None else Identity(role.value, role)
        return self.sessions.read(scope)

    def still(self, identity: Identity) -> bool:
        """Tell whether a session has not been ended meanwhile."""
        return identity.session is None or self.sessions.is_open(identity.session)

    def log_in(self, token: str, name: str, address: str) -> tuple[Identity, str]:
        """Return a new session for a token, and its cookie's value.

        Raises ServiceError 401, 429.
        """
        self._failures.check(address)
        role = self._role_of(token)
        if role is None:
            self._failures.add(address)
            raise ServiceError(
                "unauthorized", "This token is not known here.", HTTPStatus.UNAUTHORIZED
            )
        return self.sessions.open(f"{name} ({role})" if name else role.value, role)

    def link(self, role: Role) -> str:
        """Return the path of a link that logs in whoever opens it first, with this role.

        For a server without tokens on this machine: nobody else hands out roles there.
        """
        key = secrets.token_urlsafe(24)
        self._links[key] = role
        return f"/login?key={key}"

    def use_link(self, key: str, address: str) -> tuple[Identity, str]:
        """Return a new session for a link's key, which is worth nothing after that.

        Raises ServiceError 401, 429.
        """
        self._failures.check(address)
        said = _bytes(key)
        known = [k for k in self._links if hmac.compare_digest(k.encode(), said)]
        if not known:
            self._failures.add(address)
            raise ServiceError(
                "unauthorized",
                "This link lets one browser in, once: it has been used, or it is of another start."
                " Start Falconer again for new links.",
                HTTPStatus.UNAUTHORIZED,
            )
        role = self._links.pop(known[0])
        return self.sessions.open(f"{role} (link)", role)

    def _role_of(self, given: str) -> Role | None:
        """Return a token's role; every token is compared, in constant time."""
        said = _bytes(given)
        found = [t.role for t in self._tokens if hmac.compare_digest(said, t.secret)]
        return found[0] if found else None


class Failures:
    """Counts failed logins per address, and of all, in a sliding window."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._by_address: OrderedDict[str, list[float]] = OrderedDict()
        self._all: list[float] = []

    def check(self, address: str) -> None:
        """Raise ServiceError 429 while there were too many."""
        since_s = self._now() - WINDOW_S
        self._all = [at for at in self._all if at > since_s]
        of_this = [at for at in self._by_address.get(address, ()) if at > since_s]
        if len(of_this) >= MAX_FAILURES or len(self._all) >= MAX_FAILURES_OF_ALL:
            oldest = (of_this if len(of_this) >= MAX_FAILURES else self._all)[0]
            wait_s = max(1, round(oldest + WINDOW_S - self._now()))
            raise ServiceError(
                "too_many_logins",
                f"Too many failed logins; try again in {wait_s} s.",
                HTTPStatus.TOO_MANY_REQUESTS,
                {"retry_after_s": wait_s},
            )

    def add(self, address: str) -> None:
        """Count one; the addresses seen longest ago are forgotten."""
        self._all.append(self._now())
        self._by_address[address] = [
            *self._by_address.pop(address, ())[-MAX_FAILURES:],
            self._now(),
        ]
        while len(self._by_address) > MAX_ADDRESSES:
            self._by_address.popitem(last=False)


def _bytes(said: str) -> bytes:
    """Return what somebody sent, whatever it is, as something to compare."""
    return said.encode("utf-8", "surrogatepass")
