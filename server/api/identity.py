"""Who asks, and what that role may do.

Three roles, each with all that the ones before it may: a *viewer* sees, an *operator* steers
(comments, approvals, overrides, hold), an *admin* makes and removes missions, scenarios and
experiments. The table below is by path, so that a new route is never open by oversight: what
changes something needs an operator at least.
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from starlette.requests import HTTPConnection

SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})

_ADMIN: Final = (
    re.compile(r"/api/v1/(missions|scenarios|experiments|recordings)(/[^/]*)?/?"),
    re.compile(r"/api/v1/missions/[^/]+/fork/?"),
    re.compile(r"/api/v1/experiments/.*"),
)
"""What only an admin may change."""

_OWN: Final = re.compile(r"/api/v1/session|/logout")
"""What everybody may change: their own session."""


class Role(StrEnum):
    """What somebody may do."""

    VIEWER = "viewer"
    OPERATOR = "operator"
    ADMIN = "admin"

    @property
    def rank(self) -> int:
        """Greater for who may do more."""
        return list(Role).index(self)

    def covers(self, needed: "Role") -> bool:
        """Whether this role may do what `needed` may."""
        return self.rank >= needed.rank


@dataclass(frozen=True, slots=True)
class Identity:
    """Somebody who has shown who they are."""

    name: str
    """As it stands in the journal."""

    role: Role
    session: str | None = None
    """Id of the browser session; None for a program with a token."""

    csrf: str = ""
    """What a session's changes must carry in the header X-CSRF-Token."""


def needed_role(method: str, path: str) -> Role:
    """Return the least role that may ask this."""
    if method in SAFE_METHODS or _OWN.fullmatch(path):
        return Role.VIEWER
    if not path.startswith("/api/"):
        return Role.VIEWER  # the console's own transport; its handlers look at the role
    if any(pattern.fullmatch(path) for pattern in _ADMIN):
        return Role.ADMIN
    return Role.OPERATOR


def identity_of(connection: HTTPConnection) -> Identity:
    """Return who asks, as the doorkeeper found. Raises LookupError where none stands at the door.

    The doorkeeper is around the whole application, so that this never happens in a server.
    """
    identity = connection.scope.get("identity")
    if not isinstance(identity, Identity):
        raise LookupError("no doorkeeper has looked at this connection")
    return identity


def author_of(connection: HTTPConnection) -> str:
    """Return the name of who asks."""
    return identity_of(connection).name
