"""Which browser's view of the scene belongs to which page, and so to whom.

Each page gets a name of its own, which nobody can guess, and shows the scene under it
(`/scene/NAME/`). The proxy lets a connection bear that name only if it comes from the very session
that the page was built for; any other one sees the scene and nothing more. What is clicked in a
view is therefore the doing of the person whose page it is.
"""

import secrets
from dataclasses import dataclass, field
from typing import Final

from server.api.identity import Identity

NOBODY: Final = ""
"""The name of a view that belongs to no page."""


@dataclass(slots=True)
class Viewers:
    """Owner of the names of the pages that are open."""

    _pages: dict[str, Identity] = field(default_factory=dict)

    def enter(self, identity: Identity) -> str:
        """Return the name for a new page of somebody."""
        name = secrets.token_urlsafe(18)
        self._pages[name] = identity
        return name

    def leave(self, name: str) -> None:
        """Forget a page."""
        self._pages.pop(name, None)

    def name_for(self, name: str, identity: Identity) -> str:
        """Return the name that a connection of `identity` may bear: its own page's, or none."""
        owner = self._pages.get(name)
        if owner is None or (owner.session, owner.name) != (identity.session, identity.name):
            return NOBODY
        return name
