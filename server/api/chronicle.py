"""What the service writes into the journal, and reads back, in its own words."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from http import HTTPStatus
from typing import Any

import structlog

from server.api.catalogue import Definition
from server.api.errors import ServiceError
from server.api.models import Clock
from server.journal.entry import Entry, EntryKind, Sealed
from server.journal.journal import Journal, JournalUnavailable
from server.mission.setup import GateMode

log = structlog.get_logger(__name__)

MAX_AUTHOR = 100

PAGE = 1000
"""Entries read at once, where all of a kind are wanted."""


class Chronicle:
    """Writes and reads entries about missions. Owns nothing but the way they are written."""

    def __init__(self, journal: Journal) -> None:
        self.journal = journal

    # ------------------------------------------------------------------ never waits

    def event(self, mission: str, message: Mapping[str, Any], author: str = "") -> None:
        """Write what a mission told; `message` is the stream's, with its number."""
        self._post(EntryKind.EVENT, mission, message, message["time_s"], message["seq"], author)

    def state(
        self, mission: str, state: str, reason: str, author: str, time_s: float | None
    ) -> None:
        """Write that a mission took a state, or was told to."""
        body = {"state": state, "reason": reason}
        self.journal.post(
            Entry(EntryKind.STATE, mission, author[:MAX_AUTHOR], time_s=time_s, body=body)
        )

    def sample(self, mission: str, number: int, figures: Mapping[str, Any]) -> None:
        """Write the figures of one moment."""
        self._post(EntryKind.SAMPLE, mission, figures, figures["time_s"], number)

    def comment_refused(self, mission: str, comment_id: str, author: str, why: str) -> None:
        """Write that a comment did not reach the mission after all."""
        body = {"id": comment_id, "why": why}
        self.journal.post(Entry(EntryKind.COMMENT_REFUSED, mission, author[:MAX_AUTHOR], body=body))

    def request(self, author: str, body: Mapping[str, Any]) -> None:
        """Write that somebody asked for a change, and what the answer was."""
        self.journal.post(Entry(EntryKind.REQUEST, author=author[:MAX_AUTHOR], body=body))

    def session(self, author: str, body: Mapping[str, Any]) -> None:
        """Write that somebody logged in, failed to, or logged out."""
        self.journal.post(Entry(EntryKind.SESSION, author=author[:MAX_AUTHOR], body=body))

    # ------------------------------------------------------------------ durable on return

    async def made(self, mission: str, definition: Definition, author: str) -> None:
        """Write a mission's definition, without the bus and its passwords. ServiceError 503."""
        stored = asdict(definition)
        stored["planner"] = {k: v for k, v in stored["planner"].items() if k != "bus"}
        await self._commit(
            Entry(EntryKind.MISSION, mission, author[:MAX_AUTHOR], body={"definition": stored})
        )

    async def comment(
        self, mission: str, comment_id: str, text: str, author: str, time_s: float | None
    ) -> None:
        """Write a comment. ServiceError 503: then it must not reach the mission."""
        body = {"id": comment_id, "text": text}
        entry = Entry(EntryKind.COMMENT, mission, author[:MAX_AUTHOR], time_s=time_s, body=body)
        try:
            await self._commit(entry)
        except ServiceError:
            self.comment_refused(mission, comment_id, author, "journal_unavailable")
            raise

    async def final(
        self, mission: str, state: str, reason: str, author: str, time_s: float | None
    ) -> None:
        """Write a state and wait for the commit; goes on without where there is no journal."""
        body = {"state": state, "reason": reason}
        entry = Entry(EntryKind.STATE, mission, author[:MAX_AUTHOR], time_s=time_s, body=body)
        await self._commit_if_possible(entry)

    async def override(
        self,
        mission: str,
        what: str,
        asked: Mapping[str, Any],
        author: str,
        time_s: float | None,
    ) -> None:
        """Write what a person changed, with the checkpoint that holds it, and wait likewise."""
        body = {"what": what, "asked": asked}
        entry = Entry(EntryKind.OVERRIDE, mission, author[:MAX_AUTHOR], time_s=time_s, body=body)
        await self._commit_if_possible(entry)

    # ------------------------------------------------------------------ read

    async def ended_sessions(self) -> list[str]:
        """Return the sessions that were logged out, oldest first. Raises JournalUnavailable."""
        ended: list[str] = []
        after = 0
        while page := await self.journal.read("", (EntryKind.SESSION,), after, PAGE):
            ended += [e.data["session"] for e in page if e.data.get("did") == "logout"]
            after = page[-1].seq
        return ended

    async def events(self, mission: str, after: int, limit: int) -> list[dict[str, Any]]:
        """Return events after a number, oldest first. ServiceError 503."""
        return [e.data for e in await self._page(mission, EntryKind.EVENT, after, limit)]

    async def samples(self, mission: str, after: int, limit: int) -> list[dict[str, Any]]:
        """Return samples with their numbers, oldest first. ServiceError 503."""
        found = await self._page(mission, EntryKind.SAMPLE, after, limit)
        return [{"seq": e.number, "at": e.at, **e.data} for e in found]

    async def _page(self, mission: str, kind: EntryKind, after: int, limit: int) -> list[Sealed]:
        try:
            return await self.journal.page(mission, kind, after, limit)
        except JournalUnavailable as error:
            raise unavailable(error) from error

    async def _commit_if_possible(self, entry: Entry) -> None:
        """Wait for a commit; without a journal the entry waits for it instead of us."""
        try:
            await self.journal.commit(entry)
        except JournalUnavailable as error:
            log.warning("not committed", kind=entry.kind, mission=entry.mission, why=str(error))
            self.journal.post(entry)

    async def _commit(self, entry: Entry) -> None:
        try:
            await self.journal.commit(entry)
        except JournalUnavailable as error:
            raise unavailable(error) from error

    def _post(
        self,
        kind: EntryKind,
        mission: str,
        body: Mapping[str, Any],
        time_s: float | None,
        number: int,
        author: str = "",
    ) -> None:
        author = author[:MAX_AUTHOR]
        self.journal.post(Entry(kind, mission, author, time_s, number, body))


def definition_of(stored: Mapping[str, Any], bus: Mapping[str, Any]) -> Definition:
    """Return the definition that an entry holds, on the bus that the settings name now.

    Raises TypeError, ValueError and KeyError for an entry of another version.
    """
    # Those written before it stood in the definition have it in the planner's job alone.
    known = {"gate": stored["planner"].get("setup", {}).get("gate"), **stored}
    definition = Definition(**known)
    planner = {**definition.planner, "bus": dict(bus)}
    return replace(
        definition,
        planner=planner,
        clock=Clock(definition.clock),
        gate=GateMode(definition.gate),
    )


def unavailable(error: JournalUnavailable) -> ServiceError:
    """Return what a client is told."""
    return ServiceError(
        "journal_unavailable",
        f"The journal is not available, so nothing was changed: {error}.",
        HTTPStatus.SERVICE_UNAVAILABLE,
    )
